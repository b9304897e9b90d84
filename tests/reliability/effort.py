"""How hard the tests of reliability try: a little in every run, much by `make reliability`.

The numbers of docs/safety.md, docs/security.md and docs/results/reliability.md are asserted by the
tests themselves, within their bars. The worst counts. Of three measurements and more it is the
second worst, and the documents say so: two cores that also run the test's other half may hold up
one.
`make reliability` repeats every fault and shows the worst.
"""

import os
from collections.abc import Callable, Sequence

REPEATS = int(os.environ.get("MBOT_REPEATS", "1"))
"""Of a fault, each time with a fresh daemon or board."""

FUZZ_CASES = int(os.environ.get("MBOT_FUZZ_CASES", "2000"))
"""Inputs for each parser."""

GARBAGE_CASES = int(os.environ.get("MBOT_GARBAGE_CASES", str(FUZZ_CASES)))
"""Pieces of garbage from the board."""

SOAK_DECISIONS = int(os.environ.get("MBOT_SOAK_DECISIONS", "600"))

TRIES = 3


def second_worst(found: Sequence[float]) -> float:
    """What counts of several measurements: the second worst; of less than three the worst."""
    return sorted(found)[-2 if len(found) >= TRIES else -1]


def within(bar: float, measure: Callable[[], float]) -> list[float]:
    """Measure; if one is over the bar, so often that it could have been the only one."""
    found = [measure() for _ in range(REPEATS)]
    while max(found) > bar and len(found) < TRIES:
        found.append(measure())
    assert second_worst(found) <= bar, f"{found} with a bar of {bar}"
    return found
