"""Small faults put into the safety path, one at a time: a quick test must fail for each.

    python benchmarks/mutants.py [--all] [--since COMMIT] [--only TEXT ...] [--most N]

By default those on lines that have changed since COMMIT (the last commit of before yesterday).
pytest is set up once; each mutant is put into a fork of it, which runs tests that have been seen to
come by the broken function. A kill counts if the same test fails once more with it. What survives
fails the run, unless `equivalent_mutants.toml` names it and says why nobody could tell.
"""

import argparse
import gc
import hashlib
import importlib
import json
import os
import pickle
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import tomllib
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # a fork has no threads but its own

import pytest
from hypothesis import Phase, settings
from mutation.applied import NotApplicableError, apply
from mutation.operators import Mutant, mutants_of
from mutation.targets import ROOT, targets

TESTS = ("tests/robot", "tests/protocol", "tests/workstation/test_hand.py")
TESTS += ("tests/workstation/test_by_hand.py", "tests/workstation/test_remote_control.py")
WORKERS = 6
"""Most of a mutant's time is waiting for what does not come."""
CACHE = ROOT / "out/mutants"
EQUIVALENT = ROOT / "benchmarks/equivalent_mutants.toml"
TESTS_S = 30.0
"""A mutant is tried with all tests that are named for its module, and then with others: those that
have killed most, then the quickest, as long as all take this together without a mutant."""
SPARE_S = 10.0
"""A mutant that takes so much more than thrice that time runs for ever, which is noticed."""

Key = tuple[str, str]
"""File and function."""


@dataclass(slots=True)
class Reach:
    """What the tests come by.

    Attributes:
        seconds: that each test takes.
        tests: that call each function, in this process.

    """

    seconds: dict[str, float] = field(default_factory=dict[str, float])
    tests: dict[Key, set[str]] = field(default_factory=dict[Key, set[str]])


class Runner:
    """pytest's loop over tests, replaced by one over mutants."""

    def __init__(self, mutants: list[Mutant]) -> None:
        self.mutants = mutants
        self.alive: list[tuple[Mutant, str]] = []
        self.killed = 0
        self._kills: Counter[str] = Counter()
        self._failed: list[str] = []
        self._items: dict[str, pytest.Item] = {}
        self._reach = Reach()
        self._scratch = Path(tempfile.mkdtemp(prefix="mutants-"))

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            self._failed.append(report.nodeid)

    def pytest_configure(self, config: pytest.Config) -> None:
        """Nobody reads why a test fails."""
        config.option.tbstyle = "value"

    @pytest.hookimpl(tryfirst=True)
    def pytest_collection(self) -> None:
        """Before the tests are imported: a failure counts, and needs no smaller example."""
        phases = (Phase.explicit, Phase.generate)
        settings.register_profile("mutants", deadline=None, database=None, phases=phases)
        settings.load_profile("mutants")

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        self._items = {item.nodeid: item for item in session.items}
        for module in targets():  # before the fork, not once in each
            importlib.import_module(module)
        self._reach = self._reached()
        gc.collect()
        gc.freeze()  # or each child would copy what its collector looks at
        self._try(self.mutants, WORKERS)
        # Of those some live only since the others have taken the time that a test measures.
        doubtful, self.alive = [mutant for mutant, _ in self.alive], []
        self._try(doubtful, 1)
        for mutant, why in self.alive:
            print(f"SURVIVES {mutant.name} (line {mutant.line}): {why}", flush=True)
        shutil.rmtree(self._scratch, ignore_errors=True)
        return True

    def _try(self, mutants: Iterable[Mutant], workers: int) -> None:
        waiting = list(mutants)
        running: dict[int, tuple[Mutant, float, int]] = {}
        while waiting or running:
            while waiting and len(running) < workers:
                mutant = waiting.pop(0)
                tests = self._tests_for(mutant)
                if not tests:
                    self._judged(mutant, "no test comes by it")
                    continue
                reader, writer = os.pipe()
                child = self._fork(lambda m=mutant, t=tests: self._kill(m, t), writer)
                limit_s = SPARE_S + 3 * sum(self._reach.seconds[test] for test in tests)
                running[child] = mutant, time.monotonic() + limit_s, reader
            self._collect(running)

    def _collect(self, running: dict[int, tuple[Mutant, float, int]]) -> None:
        """Wait for one child to end, or to take too long."""
        child, _ = os.waitpid(-1, os.WNOHANG)
        if child == 0:
            for late, (mutant, until_s, reader) in list(running.items()):
                if time.monotonic() > until_s:
                    os.killpg(late, signal.SIGKILL)
                    os.waitpid(late, 0)
                    os.close(reader)
                    del running[late]
                    self._judged(mutant, "", "takes for ever")
            time.sleep(0.005)
            return
        if child not in running:
            return
        mutant, _, reader = running.pop(child)
        with os.fdopen(reader, "rb") as answer:
            said = answer.read().decode() or "the process died"
        kind, _, words = said.partition(" ")
        if kind == "alive":
            self._judged(mutant, words)
        else:
            self._kills[words] += 1
            self._judged(mutant, "", words)

    def _judged(self, mutant: Mutant, why: str, by: str = "") -> None:
        if why:
            self.alive.append((mutant, why))
        else:
            self.killed += 1
            if os.environ.get("MUTANTS_VERBOSE"):
                print(f"killed   {mutant.name}: {by}", flush=True)

    def _tests_for(self, mutant: Mutant) -> list[str]:
        """Those that come by the function; if none does in this process, those of files that know
        its module: they may start another one."""
        tests = self._reach.tests.get((str(mutant.file), mutant.function), set())
        if not tests:
            name = mutant.module.rpartition(".")[2]
            tests = {
                test
                for test in self._reach.seconds
                if name in (ROOT / test.partition("::")[0]).read_text()
            }
        name = f"test_{mutant.module.rpartition('.')[2]}.py"
        left_s, chosen = TESTS_S, list[str]()
        for test in sorted(tests, key=lambda one: self._order(one, name)):
            left_s -= self._reach.seconds[test]
            if left_s < 0 and chosen and f"/{name}::" not in test:
                break
            chosen.append(test)
        return chosen

    def _order(self, test: str, mirror: str) -> tuple[bool, int, float]:
        return f"/{mirror}::" not in test, -self._kills[test], self._reach.seconds[test]

    def _kill(self, mutant: Mutant, tests: list[str]) -> str:
        try:
            apply(mutant)
        except NotApplicableError:
            return "alive it can't be put in place"
        for test in tests:
            if self._fails(test) and self._fails(test):
                return f"killed {test}"
        return f"alive {len(tests)} tests pass"

    def _fails(self, test: str) -> bool:
        self._failed.clear()
        item = self._items[test]
        item.config.hook.pytest_runtest_protocol(item=item, nextitem=None)
        return bool(self._failed)

    def _fork(self, act: Callable[[], str], writer: int) -> int:
        """A child that does something, and writes what came of it into a pipe."""
        sys.stdout.flush()
        child = os.fork()
        if child:
            os.close(writer)
            return child
        os.setsid()
        nowhere = os.open(os.devnull, os.O_RDWR)
        for descriptor in (0, 1, 2):
            os.dup2(nowhere, descriptor)
        scratch = self._scratch / str(os.getpid())
        try:
            config: Any = next(iter(self._items.values())).config
            factory = config._tmp_path_factory  # each child has a folder of its own
            factory._given_basetemp, factory._basetemp = scratch, None
            os.write(writer, act().encode())
        finally:
            shutil.rmtree(scratch, ignore_errors=True)
            os._exit(0)

    def _reached(self) -> Reach:
        """Which tests call what, looked up again when anything has changed."""
        sources = sorted([*targets().values(), *(ROOT / "tests").rglob("*.py")])
        digest = hashlib.sha256(b"".join(path.read_bytes() for path in sources)).hexdigest()[:16]
        cached = CACHE / f"reach-{digest}.pickle"
        if cached.exists():
            return pickle.loads(cached.read_bytes())  # our own, made here
        print(f"seeing what {len(self._items)} tests come by ...", flush=True)
        names = list(self._items)
        readers: list[int] = []
        for number in range(WORKERS):
            reader, writer = os.pipe()
            self._fork(lambda n=number: self._watched(names[n::WORKERS]), writer)
            readers.append(reader)
        reach = Reach()
        for reader in readers:
            with os.fdopen(reader) as answer:
                said = json.loads(answer.read())
            reach.seconds |= said["seconds"]
            for file, function, tests in said["tests"]:
                reach.tests.setdefault((file, function), set()).update(tests)
            if said["failed"]:
                print(f"without any mutant fail, and are left out: {said['failed']}", flush=True)
        for _ in readers:
            os.wait()
        CACHE.mkdir(parents=True, exist_ok=True)
        cached.write_bytes(pickle.dumps(reach))
        return reach

    def _watched(self, tests: Iterable[str]) -> str:
        files = {str(path) for path in targets().values()}
        called: set[Key] = set()

        def look(frame: FrameType, event: str, _: object) -> None:
            if event == "call" and frame.f_code.co_filename in files:
                outermost = frame.f_code.co_qualname.partition(".<locals>")[0]
                called.add((frame.f_code.co_filename, outermost))

        seconds: dict[str, float] = {}
        reached: dict[Key, list[str]] = {}
        failed: list[str] = []
        threading.setprofile(look)
        for test in tests:
            called.clear()
            began_s = time.monotonic()
            sys.setprofile(look)
            fails = self._fails(test)
            sys.setprofile(None)
            if fails:
                failed.append(test)
                continue
            seconds[test] = time.monotonic() - began_s
            for key in set(called):
                reached.setdefault(key, []).append(test)
        found = [[*key, names] for key, names in reached.items()]
        return json.dumps({"seconds": seconds, "tests": found, "failed": failed})


def changed_lines(since: str) -> dict[Path, set[int]]:
    """Lines of each file that are not what they were."""
    command = ["git", "diff", "--unified=0", since, "--", "robot", "shared", "workstation"]
    found: dict[Path, set[int]] = {}
    file = ROOT
    for line in subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.splitlines():
        if line.startswith("+++ b/"):
            file = ROOT / line[6:]
        elif place := re.match(r"@@ .* \+(\d+)(?:,(\d+))? @@", line):
            begin, count = int(place[1]), int(place[2] or 1)
            found.setdefault(file, set()).update(range(begin, begin + count))
    return found


def yesterday() -> str:
    """The last commit that was there a day before the newest one."""
    when = _git("log", "-1", "--format=%ct")
    return _git("rev-list", "-1", f"--before={int(when) - 86_400}", "HEAD") or _git(
        "rev-list", "--max-parents=0", "HEAD"
    )


def _git(*arguments: str) -> str:
    done = subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=True)
    return done.stdout.strip()


def main() -> int:
    parser = argparse.ArgumentParser(description="Put small faults into the safety path.")
    parser.add_argument("--all", action="store_true", help="not only on lines that have changed")
    parser.add_argument("--since", metavar="COMMIT", help="changed since then")
    parser.add_argument("--only", nargs="*", default=[], metavar="TEXT", help="names with this")
    parser.add_argument("--not", nargs="*", default=[], metavar="TEXT", dest="but", help="without")
    parser.add_argument("--most", type=int, metavar="N", help="so many of them, by chance")
    parser.add_argument("--list", action="store_true", help="name them, and end")
    arguments = parser.parse_args()
    generated = [one for module, file in targets().items() for one in mutants_of(module, file)]
    equivalent: dict[str, str] = {
        name: why
        for name, why in tomllib.loads(EQUIVALENT.read_text()).items()
        if not name.startswith("firmware:")  # firmware_mutants.py
    }
    if gone := equivalent.keys() - {one.name for one in generated}:
        print(f"{EQUIVALENT.name} names what is not generated: {', '.join(sorted(gone))}")
        return 1
    mutants = [one for one in generated if one.name not in equivalent]
    if not arguments.all:
        changed = changed_lines(arguments.since or yesterday())
        mutants = [one for one in mutants if one.line in changed.get(one.file, ())]
    if arguments.only:
        mutants = [one for one in mutants if any(text in one.name for text in arguments.only)]
    mutants = [one for one in mutants if not any(text in one.name for text in arguments.but)]
    if arguments.most is not None:  # the same ones each time
        mutants.sort(key=lambda one: hashlib.sha256(one.name.encode()).digest())
        mutants = mutants[: arguments.most]
    if arguments.list:
        print("\n".join(one.name for one in mutants))
        return 0
    began_s = time.monotonic()
    runner = Runner(mutants)
    quiet = [
        "-p",
        "no:terminal",
        "-p",
        "no:cacheprovider",
        "-p",
        "no:xdist",
        "--capture=no",
    ]
    os.chdir(ROOT)
    ended = pytest.main([*quiet, "-m", "not slow", *TESTS], plugins=[runner])
    if ended not in (pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED):
        print(f"pytest ended with {ended}")
        return 1
    print(
        f"{len(generated)} generated, {len(equivalent)} equivalent; {runner.killed} of "
        f"{len(mutants)} killed in {time.monotonic() - began_s:.0f} s"
    )
    return 1 if runner.alive else 0


if __name__ == "__main__":
    sys.exit(main())
