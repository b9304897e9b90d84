"""A page as filled shapes and text, in millimetres; what is in it knows no file format."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Point = tuple[float, float]
"""x to the right and y down, from the page's upper left corner."""

BLACK, GREY, WHITE = 0.0, 0.45, 1.0


@dataclass(frozen=True, slots=True)
class Paper:
    """A sheet, upright.

    Attributes:
        name: as it is sold.
        width_mm, height_mm: its size.

    """

    name: str
    width_mm: float
    height_mm: float


PAPERS = {
    "a4": Paper("A4", 210.0, 297.0),
    "letter": Paper("Letter", 215.9, 279.4),
    "a3": Paper("A3", 297.0, 420.0),
}


@dataclass(frozen=True, slots=True)
class FilledShape:
    """Polygons filled with one grey; those of one shape touch without a seam.

    Attributes:
        polygons: each a closed outline.
        grey: 0 is black, 1 is white.

    """

    polygons: tuple[tuple[Point, ...], ...]
    grey: float = BLACK


@dataclass(frozen=True, slots=True)
class Text:
    """One line.

    Attributes:
        at: the left end of its base line.
        size_mm: of the letters' em.
        words: Latin-1 only, as the fonts every printer has.

    """

    at: Point
    size_mm: float
    words: str


@dataclass(slots=True)
class Page:
    """A page that is being filled.

    Attributes:
        width_mm, height_mm: its size as it is looked at.
        title: of the file.
        shapes, texts: what is on it, later ones on top.

    """

    width_mm: float
    height_mm: float
    title: str
    shapes: list[FilledShape] = field(default_factory=list[FilledShape])
    texts: list[Text] = field(default_factory=list[Text])

    def fill(self, polygons: Iterable[Sequence[Point]], grey: float = BLACK) -> None:
        """Add polygons."""
        self.shapes.append(FilledShape(tuple(tuple(polygon) for polygon in polygons), grey))

    def write(self, at: Point, words: str, size_mm: float = 3.2) -> None:
        """Add a line of text."""
        self.texts.append(Text(at, size_mm, words))


def rectangle(left: float, top: float, width: float, height: float) -> tuple[Point, ...]:
    """The outline of a rectangle, clockwise from the upper left corner."""
    right, bottom = left + width, top + height
    return ((left, top), (right, top), (right, bottom), (left, bottom))


def cells(
    black: NDArray[np.bool_], left: float, top: float, edge: float
) -> list[tuple[Point, ...]]:
    """The black cells of a grid; neighbours in a row become one rectangle.

    Args:
        black: shape (rows, columns).
        left, top: of the grid.
        edge: of one cell.

    """
    found: list[tuple[Point, ...]] = []
    for row, line in enumerate(black):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], line.astype(np.int8), [0]])))
        for start, end in edges.reshape(-1, 2).tolist():
            found.append(
                rectangle(left + start * edge, top + row * edge, (end - start) * edge, edge)
            )
    return found
