"""How hard the tests of reliability try: a little in every run, much by `make reliability`.

The numbers of docs/safety.md, docs/security.md and docs/results/reliability.md are asserted by the
tests themselves, within their bars. Where a busy machine can only add time, the best of three
counts; `make reliability` repeats every fault and shows the worst.
"""

import os
from collections.abc import Callable

REPEATS = int(os.environ.get("MBOT_REPEATS", "1"))
"""Of a fault, each time with a fresh daemon or board."""

FUZZ_CASES = int(os.environ.get("MBOT_FUZZ_CASES", "2000"))
"""Inputs for each parser."""

GARBAGE_CASES = int(os.environ.get("MBOT_GARBAGE_CASES", str(FUZZ_CASES)))
"""Pieces of garbage from the board."""

SOAK_DECISIONS = int(os.environ.get("MBOT_SOAK_DECISIONS", "600"))

TRIES = 3


def within(bar: float, measure: Callable[[], float]) -> list[float]:
    """Measure, again if only the machine may have been slow; the best of three keeps the bar."""
    found = [measure() for _ in range(REPEATS)]
    while min(found) > bar and len(found) < TRIES:
        found.append(measure())
    assert min(found) <= bar, f"{found} with a bar of {bar}"
    return found
