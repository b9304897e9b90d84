"""The numbers that the documents promise, each read where it stands, by the id behind it.

A table says `within 100 ms<!--stop-log-unread-->`; the comment shows on no rendered page. A test
asserts with `promised("stop-log-unread")`, so that no document says another number than its test
holds. One promise may stand on several pages; `tests/test_promises.py` holds that they agree.
"""

import re
from functools import cache
from pathlib import Path
from typing import NamedTuple

CHECKOUT = Path(__file__).parents[1]
FAULTS = CHECKOUT / "benchmarks" / "fault_table.py"
"""What docs/results/reliability.md is made of; the page of the quick lane lacks the soak."""

PAGES = ("arming.md", "safety.md", "security.md", "results/reliability.md")
"""Those of `docs` whose tables promise in numbers."""

NUMBER = r"(?<![\w.])\d[\d,]*(?:\.\d+)?"
PROMISE = re.compile(rf"({NUMBER})(?: [^\W\d]+| %)?<!--([a-z][a-z-]*)-->")
"""A number, its unit if it has one, its id."""


class Place(NamedTuple):
    """One place where a promise stands.

    Attributes:
        name: the promise's id.
        number: in the document's unit.
        file: in which it stands.

    """

    name: str
    number: float
    file: Path


def promises_in(text: str) -> list[tuple[str, float]]:
    """Id and number of each promise."""
    return [(name, float(digits.replace(",", ""))) for digits, name in PROMISE.findall(text)]


@cache
def places() -> tuple[Place, ...]:
    """Of all promises: in the documents, and in what one of them is made of."""
    files = (*(CHECKOUT / "docs" / page for page in PAGES), FAULTS)
    return tuple(
        Place(name, number, file)
        for file in files
        for name, number in promises_in(file.read_text())
    )


def promised(name: str) -> float:
    """The number of a promise, in the unit of the document.

    Raises:
        KeyError: no document promises it.

    """
    return {place.name: place.number for place in places()}[name]
