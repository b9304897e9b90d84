"""Every fault of the table, caused on purpose: what was promised and what was measured.

    python benchmarks/reliability.py [--quick] [--garbage 100000] [-o docs/results/reliability.md]
    python benchmarks/reliability.py --quick --of out/tests

With `--quick` every fault is caused once and the soak is left out. Runs exactly the tests that the
table names, then writes the page, which says what was tried; with `--of` it goes by what a run of
all tests has reported. Its exit code is 1 if a row has no test, a test fails or a bar is not met.
Use a quiet machine: most bars are times.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from itertools import chain
from pathlib import Path
from xml.etree import ElementTree

from fault_table import BESIDE, FAULTS, SOAK, Bar, Effort, Fault
from machine import machine

from mbot_workstation.learn.evaluation.provenance import provenance

ROOT = Path(__file__).parents[1]
RESULT = ROOT / "docs" / "results" / "reliability.md"

THOROUGH = Effort(repeats=5, fuzz=100_000, garbage=100_000, soak=10_000)
QUICK = Effort(repeats=1, fuzz=2000, garbage=2000, soak=600)

HEAD = """\
# Faults and what becomes of them

Made by `{command}` on {date} in {minutes:.0f} minutes: {machine}, a pseudo-terminal in place
of the board's port, a camera over HTTP, nothing of a Raspberry Pi. Each row runs the tests it
names; of several values the worst one is shown. {survived} of {all} faults of the table kept within
every bar, {also} of {beside} others.

{provenance}

{lane}

| fault | bar | measured | met | way back | tests |
|---|---|---|---|---|---|
"""

QUICK_LANE = """\
The quick lane: every fault once, no soak. Each test decides by its own bar: the worst counts, of
three measurements and more the second worst. `make reliability` causes each fault five times, with
100,000 inputs to each parser and a soak of 10,000 decisions, and every try counts."""

THOROUGH_LANE = "The thorough lane: every fault {repeats} times, and every try counts."

TAIL = """
A pseudo-terminal has no baud rate: on the wire a stop burst takes 5.4 ms more. Times of the
firmware are simulated ones of the compiled binary in an AVR simulator. What a row's number does
not cover, a machine with other work to do among it, stands in [safety.md](../safety.md).
"""


@dataclass
class Outcome:
    """One test that ran: a name, whether it passed, what it recorded."""

    test: str
    passed: bool
    measured: dict[str, float] = field(default_factory=dict)


def run(tests: Sequence[str], effort: Effort) -> list[Outcome]:
    """Run tests, in one session; each parametrized case is an outcome of its own."""
    told = {
        "MBOT_REPEATS": effort.repeats,
        "MBOT_FUZZ_CASES": effort.fuzz,
        "MBOT_GARBAGE_CASES": effort.garbage,
        "MBOT_SOAK_DECISIONS": effort.soak,
    }
    environment = os.environ | {name: str(value) for name, value in told.items()}
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *tests]
        command.append(f"--junitxml={Path(folder) / 'report.xml'}")
        subprocess.run(command, cwd=ROOT, env=environment, check=False)
        return reported(Path(folder))


def reported(folder: Path) -> list[Outcome]:
    """What pytest has written into a folder's reports."""
    cases = [ElementTree.parse(report).iter("testcase") for report in sorted(folder.glob("*.xml"))]
    return [_outcome(case) for case in chain.from_iterable(cases)]


def suites_s(folder: Path) -> float:
    """How long those took that have written a folder's reports."""
    suites = [ElementTree.parse(report).iter("testsuite") for report in folder.glob("*.xml")]
    return sum(float(suite.get("time", 0)) for suite in chain.from_iterable(suites))


def _outcome(case: ElementTree.Element) -> Outcome:
    name = case.get("name", "").partition("[")[0]
    # Not the file: for a state machine that is Hypothesis' own.
    modules = [part for part in case.get("classname", "").split(".") if part[:1].islower()]
    test = f"{'/'.join(modules)}.py::{name}"
    broken = any(case.find(tag) is not None for tag in ("failure", "error", "skipped"))
    measured: dict[str, float] = {}
    for entry in case.iter("property"):
        try:
            measured[entry.get("name", "")] = float(entry.get("value", ""))
        except ValueError:
            continue
    return Outcome(test, not broken, measured)


def outcomes_of(fault: Fault, outcomes: Sequence[Outcome]) -> list[Outcome]:
    """Those of a row's tests, which may name whole files."""
    return [
        outcome
        for outcome in outcomes
        if outcome.test in fault.tests or outcome.test.partition("::")[0] in fault.tests
    ]


def is_met(fault: Fault, outcomes: Sequence[Outcome], *, quick: bool = False) -> bool:
    """Whether each test of the row was there and passed, and each bar holds, every time.

    Quickly, the tests alone decide: they hold each number to its bar, of three and more the second
    worst.
    """
    there = all(
        any(outcome.test == test or outcome.test.startswith(f"{test}::") for outcome in outcomes)
        for test in fault.tests
    )
    values = [(bar, values_of(bar, outcomes)) for bar in fault.bars]
    return (
        there
        and all(outcome.passed for outcome in outcomes)
        and (quick or all(bar.is_met(found) for bar, found in values))
    )


def values_of(bar: Bar, outcomes: Sequence[Outcome]) -> list[float]:
    """Everything recorded under the bar's name."""
    return [o.measured[bar.measured] for o in outcomes if bar.measured in o.measured]


def row(fault: Fault, outcomes: Sequence[Outcome], effort: Effort) -> str:
    """One line of the table."""
    passed = sum(outcome.passed for outcome in outcomes)
    bars, measured = [bar.words for bar in fault.bars], [worst(b, outcomes) for b in fault.bars]
    if not fault.bars:
        bars, measured = [fault.promise], [f"{passed} of {len(outcomes)} tests"]
    elif passed < len(outcomes):
        measured.append(f"{len(outcomes) - passed} tests failed")
    met = "yes" if is_met(fault, outcomes, quick=effort.repeats == 1) else "**no**"
    name = fault.name.format_map(asdict(effort))
    tests = _linked(fault.tests)
    cells = (name, "; ".join(bars), "; ".join(measured), met, fault.back, tests)
    return f"| {' | '.join(cells)} |"


def worst(bar: Bar, outcomes: Sequence[Outcome]) -> str:
    """The value furthest from the promise, with the unit that its name ends in."""
    values = values_of(bar, outcomes)
    if not values:
        return "nothing"
    unit = bar.measured.rpartition(" ")[2]
    shown = f"{(min if bar.least else max)(values):,g}"
    return f"{shown} {unit}" if unit in ("ms", "s", "MB", "%") else shown


def _linked(tests: Sequence[str]) -> str:
    """The tests by name, each a link to its file."""
    names = [test.rpartition("::")[2].rpartition("/")[2] for test in tests]
    paths = [test.partition("::")[0] for test in tests]
    return ", ".join(f"[{n}](../../{p})" for n, p in zip(names, paths, strict=True))


def page(found: dict[Fault, list[Outcome]], effort: Effort, command: str, minutes: float) -> str:
    """The whole page, from what each row's tests have said."""
    quick = effort.repeats == 1
    met = {fault for fault, outcomes in found.items() if is_met(fault, outcomes, quick=quick)}
    head = HEAD.format(
        command=command,
        date=f"{datetime.now(UTC):%Y-%m-%d}",
        minutes=minutes,
        machine=machine(),
        survived=len(met.intersection(FAULTS)),
        all=len(FAULTS),
        also=len(met.intersection(BESIDE)),
        beside=len(set(found).intersection(BESIDE)),
        provenance=provenance([]),
        lane=QUICK_LANE if quick else THOROUGH_LANE.format_map(asdict(effort)),
    )
    return head + "\n".join(row(fault, found[fault], effort) for fault in found) + "\n" + TAIL


def main() -> int:
    parser = argparse.ArgumentParser(description="Cause every fault of the table.")
    parser.add_argument("--quick", action="store_true", help="every row once, no soak")
    parser.add_argument("--garbage", type=int, metavar="N", help="pieces of serial garbage")
    parser.add_argument("--of", type=Path, metavar="FOLDER", help="of reports; runs nothing")
    parser.add_argument("-o", "--output", type=Path, default=RESULT, metavar="FILE")
    arguments = parser.parse_args()
    quick: bool = arguments.quick
    effort = QUICK if quick else THOROUGH
    command = "make reliability-quick" if quick else "make reliability"
    if arguments.of is not None:
        command = "make test-all"
    if arguments.garbage is not None:
        effort = replace(effort, garbage=arguments.garbage)
        command += f" RELIABILITY='--garbage {arguments.garbage}'"
    faults = [fault for fault in (*FAULTS, *BESIDE) if not (quick and fault.name == SOAK)]
    if arguments.of is None:
        tests = dict.fromkeys(test for fault in faults for test in fault.tests)
        began_s = time.monotonic()
        outcomes = run(list(tests), effort)
        taken_s = time.monotonic() - began_s
    else:
        outcomes, taken_s = reported(arguments.of), suites_s(arguments.of)
    found = {fault: outcomes_of(fault, outcomes) for fault in faults}
    text = page(found, effort, command, taken_s / 60)
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    arguments.output.write_text(text)
    print(text)
    return 0 if all(is_met(fault, found[fault], quick=quick) for fault in faults) else 1


if __name__ == "__main__":
    sys.exit(main())
