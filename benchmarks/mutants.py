"""Small faults put into the safety path, one at a time: for each, the test it names must fail.

    python benchmarks/mutants.py [--passed] [NAME ...]

Works on copies of the tree; exit code 1 if a mutant survives, or if a named test fails without one,
which --passed says it does not. Threads of a busy machine can hide a fault once: what survives is
tried again, alone, and named if it was killed only then. The mutants are in `mutant_table.py`.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from mutant_table import MUTANTS, Mutant

ROOT = Path(__file__).parents[1]
PARTS = ("robot", "shared", "workstation", "tests", "deploy", "models", "pyproject.toml")
WORKERS = 4
"""Most of a mutant's time is waiting for what does not come."""
TRIES_ALONE = 2
TESTS_FAILED = 1
"""pytest's exit code; any other one is a mistake of ours, and kills nothing."""


def copy_of_the_tree(folder: Path) -> Path:
    """A tree to break; the environment stays the one that runs this."""
    for name in PARTS:
        source = ROOT / name
        if source.is_dir():
            shutil.copytree(source, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(source, folder / name)
    return folder


def run_tests(tree: Path, *tests: str) -> tuple[int, str]:
    """pytest's exit code and its last words."""
    path = os.pathsep.join(str(tree / one) for one in ("shared/protocol", "robot", "workstation"))
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *tests]
    done = subprocess.run(
        command,
        cwd=tree,
        env=os.environ | {"PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    return done.returncode, (done.stdout + done.stderr)[-600:]


def is_killed(tree: Path, mutant: Mutant) -> tuple[bool, str]:
    """Whether the mutant's test fails with it; the tree is afterwards what it was."""
    path = tree / mutant.file
    whole = path.read_text()
    if whole.count(mutant.was) != 1:
        return False, f"{mutant.was!r} is {whole.count(mutant.was)} times in {mutant.file}"
    path.write_text(whole.replace(mutant.was, mutant.becomes))
    try:
        code, words = run_tests(tree, mutant.test)
    finally:
        path.write_text(whole)
    if code == TESTS_FAILED:
        return True, ""
    return False, "it survives" if code == 0 else f"pytest ended with {code}: {words}"


def judge(mutants: list[Mutant]) -> list[tuple[Mutant, str]]:
    """Those that were not killed, and why."""
    alive: list[tuple[Mutant, str]] = []
    with tempfile.TemporaryDirectory() as folder:
        trees = [copy_of_the_tree(Path(folder) / str(number)) for number in range(WORKERS)]

        def work(number: int) -> None:
            for mutant in mutants[number::WORKERS]:
                killed, why = is_killed(trees[number], mutant)
                print(f"{'killed  ' if killed else 'SURVIVES'} {mutant.name} {why}", flush=True)
                if not killed:
                    alive.append((mutant, why))

        with ThreadPoolExecutor(WORKERS) as workers:
            list(workers.map(work, range(WORKERS)))
        return [one for one in alive if not is_killed_alone(trees[0], one[0])]


def is_killed_alone(tree: Path, mutant: Mutant) -> bool:
    """Whether one of a few more tries kills it, with nothing else running."""
    for number in range(1, TRIES_ALONE + 1):
        if is_killed(tree, mutant)[0]:
            print(f"killed   {mutant.name} (alone, try {number})", flush=True)
            return True
    return False


def what_fails_without(mutants: list[Mutant]) -> str:
    """pytest's last words on the tests of a whole tree; empty if all pass."""
    tests = sorted({mutant.test for mutant in mutants})
    with tempfile.TemporaryDirectory() as folder:
        code, words = run_tests(copy_of_the_tree(Path(folder) / "whole"), *tests)
    return f"pytest ended with {code}: {words}" if code else ""


def main() -> int:
    parser = argparse.ArgumentParser(description="Put small faults into the safety path.")
    parser.add_argument("names", nargs="*", help="of mutants; all if none is given")
    parser.add_argument(
        "--passed", action="store_true", help="the tests have just passed without a mutant"
    )
    arguments = parser.parse_args()
    names = arguments.names
    mutants = [mutant for mutant in MUTANTS if not names or mutant.name in names]
    began_s = time.monotonic()
    if not arguments.passed and (words := what_fails_without(mutants)):
        print(f"without any mutant the tests fail:\n{words}")
        return 1
    alive = judge(mutants)
    took_s = time.monotonic() - began_s
    for mutant, why in alive:
        print(f"SURVIVES {mutant.name} ({mutant.test}): {why}")
    print(f"{len(mutants) - len(alive)} of {len(mutants)} mutants killed in {took_s:.0f} s")
    return 1 if alive else 0


if __name__ == "__main__":
    sys.exit(main())
