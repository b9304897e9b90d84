"""Every fault of the table, caused on purpose: what was promised and what was measured.

    python benchmarks/reliability.py [--quick] [-o docs/results/reliability.md]

With `--quick` every fault is caused once and the soak is left out; nothing is written.

Runs exactly the tests that the table names, then writes it. Its exit code is 1 if a row has no
test, a test fails or a bar is not met. Use a quiet machine: most bars are times.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from xml.etree import ElementTree

from fault_table import BESIDE, FAULTS, SOAK, Bar, Fault
from machine import machine

from mbot_workstation.training.evaluation.provenance import provenance

ROOT = Path(__file__).parents[1]
RESULT = ROOT / "docs" / "results" / "reliability.md"

THOROUGH = {"MBOT_REPEATS": "5", "MBOT_FUZZ_CASES": "100000", "MBOT_SOAK_DECISIONS": "10000"}
QUICK = {"MBOT_REPEATS": "1", "MBOT_FUZZ_CASES": "2000", "MBOT_SOAK_DECISIONS": "600"}

HEAD = """\
# Faults and what becomes of them

Made by `make reliability` on {date} in {minutes:.0f} minutes: {machine}, a pseudo-terminal in place
of the board's port, a camera over HTTP, nothing of a Raspberry Pi. Each row runs the tests it
names; of several values the worst one is shown. {verdict}

{provenance}

Repeated per fault: {MBOT_REPEATS}. Inputs per parser: {MBOT_FUZZ_CASES}. Decisions of the soak:
{MBOT_SOAK_DECISIONS}.

| fault | bar | measured | met | tests |
|---|---|---|---|---|
"""

TAIL = """
A pseudo-terminal has no baud rate: on the wire a stop burst takes 5.4 ms more. Times of the
firmware are simulated ones of the compiled binary in an AVR simulator. What a row's number does
not cover stands in [safety.md](../safety.md).
"""


@dataclass
class Outcome:
    """One test that ran: a name, whether it passed, what it recorded."""

    test: str
    passed: bool
    measured: dict[str, float] = field(default_factory=dict)


def run(tests: Sequence[str], effort: dict[str, str]) -> list[Outcome]:
    """Run tests, in one session; each parametrized case is an outcome of its own."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.xml"
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *tests]
        command += ["-o", "junit_family=xunit1", f"--junitxml={report}"]
        subprocess.run(command, cwd=ROOT, env=os.environ | effort, check=False)
        if not report.exists():
            return []
        return [_outcome(case) for case in ElementTree.parse(report).iter("testcase")]


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

    Quickly, the tests alone decide: they hold each number to its bar, the best of three tries.
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


def row(fault: Fault, outcomes: Sequence[Outcome], *, quick: bool = False) -> str:
    """One line of the table."""
    passed = sum(outcome.passed for outcome in outcomes)
    bars, measured = [bar.words for bar in fault.bars], [worst(b, outcomes) for b in fault.bars]
    if not fault.bars:
        bars, measured = [fault.promise], [f"{passed} of {len(outcomes)} tests"]
    elif passed < len(outcomes):
        measured.append(f"{len(outcomes) - passed} tests failed")
    met = "yes" if is_met(fault, outcomes, quick=quick) else "**no**"
    cells = (fault.name, "; ".join(bars), "; ".join(measured), met, _linked(fault.tests))
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


def main() -> int:
    parser = argparse.ArgumentParser(description="Cause every fault of the table.")
    parser.add_argument("--quick", action="store_true", help="every row once, no soak, no page")
    parser.add_argument("-o", "--output", type=Path, default=RESULT, metavar="FILE")
    arguments = parser.parse_args()
    effort = QUICK if arguments.quick else THOROUGH
    faults = (*FAULTS, *BESIDE)
    if arguments.quick:
        faults = tuple(fault for fault in faults if fault.name != SOAK)
    began_s = time.monotonic()
    outcomes = run(list(dict.fromkeys(test for fault in faults for test in fault.tests)), effort)
    found = {fault: outcomes_of(fault, outcomes) for fault in faults}
    quick = arguments.quick
    survived = sum(is_met(fault, found[fault], quick=quick) for fault in FAULTS)
    met = all(is_met(fault, found[fault], quick=quick) for fault in faults)
    text = HEAD.format(
        date=f"{datetime.now(UTC):%Y-%m-%d}",
        minutes=(time.monotonic() - began_s) / 60,
        machine=machine(),
        verdict=f"{survived} of {len(FAULTS)} faults of the table kept within every bar.",
        provenance=provenance([]),
        **effort,
    )
    text += "\n".join(row(fault, found[fault], quick=quick) for fault in faults) + "\n" + TAIL
    if not arguments.quick:
        arguments.output.parent.mkdir(parents=True, exist_ok=True)
        arguments.output.write_text(text)
    print(text)
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
