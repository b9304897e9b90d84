"""What the pages hold: a board, the robot's marker, the frame around a gray card."""

import numpy as np

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.measure.targets.sheet import GREY, Page, Paper, Point, cells, rectangle
from mbot_workstation.measure.targets.specifications import (
    CARD_MARKER_EDGE_MM,
    CARD_MARKER_IDS,
    MARKER_DICTIONARY,
    Board,
    marker_cells,
)

EDGE_MM = 8.0
"""No ink nearer to the paper's edge: most printers leave 4 to 6 mm white."""

SCALE_MM = 100
_LINE_MM = 0.25
_ARROW_MM = 14.0
_FOOT_MM = 15.0
"""For the scale and the text below everything else."""


def board_page(board: Board, paper: Paper) -> Page:
    """A checkerboard or ChArUco board, lying.

    Raises:
        ConfigurationError: it does not fit on the paper.

    """
    page = Page(paper.height_mm, paper.width_mm, board.name)
    width, height = board.columns * board.square_mm, board.rows * board.square_mm
    room = page.width_mm - 2 * EDGE_MM, page.height_mm - EDGE_MM - _FOOT_MM
    if width > room[0] or height > room[1]:
        largest = int(min(room[0] / board.columns, room[1] / board.rows))
        raise ConfigurationError(
            f"a {board.name} of {board.square_mm:g} mm is {width:g} x {height:g} mm, {paper.name} "
            f"has room for {room[0]:.0f} x {room[1]:.0f}; squares of {largest} mm would fit "
            "(--square-mm), or take larger paper"
        )
    left = (page.width_mm - width) / 2
    top = EDGE_MM + (room[1] - height) / 2
    columns, rows = np.meshgrid(np.arange(board.columns), np.arange(board.rows))
    page.fill(cells((columns + rows) % 2 == 0, left, top, board.square_mm))
    kind = f"{board.name}, {board.square_mm:g} mm each"
    if board.charuco:
        _fill_markers(page, board, left, top)
        kind += f", markers {board.marker_mm:g} mm, {board.dictionary} from 0"
    corners = board.inner_corners
    _foot(page, f"{kind}, {corners[0]} x {corners[1]} inner corners. Glue it on something flat.")
    return page


def _fill_markers(page: Page, board: Board, left: float, top: float) -> None:
    margin = (board.square_mm - board.marker_mm) / 2
    number = 0
    for row in range(board.rows):
        for column in range(board.columns):
            if (row + column) % 2 == 1:
                black = marker_cells(board.dictionary, number)
                at = left + column * board.square_mm, top + row * board.square_mm
                edge = board.marker_mm / len(black)
                page.fill(cells(black, at[0] + margin, at[1] + margin, edge))
                number += 1


def marker_page(number: int, edge_mm: float, paper: Paper) -> Page:
    """The marker for the top of the robot, with an arrow that points forward on the same card.

    Raises:
        ConfigurationError: it does not fit on the paper.

    """
    page = Page(paper.width_mm, paper.height_mm, f"marker {number} for the top of the robot")
    black = marker_cells(MARKER_DICTIONARY, number)
    cell = edge_mm / len(black)
    width = edge_mm + 2 * cell  # a white cell all around belongs to a marker
    height = width + _ARROW_MM
    room = page.width_mm - 2 * EDGE_MM, page.height_mm - EDGE_MM - _FOOT_MM - 40
    if width > room[0] or height > room[1]:
        raise ConfigurationError(
            f"a marker of {edge_mm:g} mm is {width:.0f} x {height:.0f} mm with its margin and "
            f"arrow, {paper.name} has room for {room[0]:.0f} x {room[1]:.0f}; choose a smaller one "
            "with --edge-mm"
        )
    left, top = (page.width_mm - width) / 2, EDGE_MM + 10
    _outline(page, left, top, width, height)
    _arrow(page, page.width_mm / 2, top + 2)
    page.write((page.width_mm / 2 + 12, top + 9), "forward", 5)
    page.fill(cells(black, left + cell, top + _ARROW_MM + cell, cell))
    below = top + height + 8
    page.write(
        (left, below), "Cut along the thin line: the white margin must stay. Glue it flat on"
    )
    page.write((left, below + 5), "top of the robot, the marker's centre above the axle's middle,")
    page.write((left, below + 10), "the arrow to the front.")
    _foot(page, f"ArUco marker {number} of {MARKER_DICTIONARY}, {edge_mm:g} mm edge.")
    return page


def _arrow(page: Page, middle: float, top: float) -> None:
    tip, shaft = top + 6, top + _ARROW_MM - 3
    right = [(middle, top), (middle + 8, tip), (middle + 3, tip), (middle + 3, shaft)]
    page.fill([[*right, *((2 * middle - x, y) for x, y in reversed(right[1:]))]])


def card_page(card_mm: tuple[float, float], paper: Paper) -> Page:
    """A place for a gray card between four markers, which tell how the card is turned.

    Args:
        card_mm: width and height of the card.
        paper: lying.

    Raises:
        ConfigurationError: the card does not fit between the markers.

    """
    page = Page(paper.height_mm, paper.width_mm, "frame for a gray card")
    width, height = card_mm
    place = card_place(page.width_mm, page.height_mm)
    if width > place[2] or height > place[3] or min(card_mm) < 20:
        raise ConfigurationError(
            f"a card of {width:g} x {height:g} mm does not fit, the frame on {paper.name} takes 20 "
            f"to {place[2]:.0f} x {place[3]:.0f} mm (--card-mm)"
        )
    for number, (left, top) in zip(
        CARD_MARKER_IDS, card_marker_places(page.width_mm, page.height_mm), strict=True
    ):
        black = marker_cells(MARKER_DICTIONARY, number)
        page.fill(cells(black, left, top, CARD_MARKER_EDGE_MM / len(black)))
    left, top = place[0] + (place[2] - width) / 2, place[1] + (place[3] - height) / 2
    _outline(page, left, top, width, height)
    page.write((left + 4, top + 9), "Gray card here, flat, lit as the arena is.", 4)
    page.write((left + 4, top + 15), "Printed gray will not do: it is not colour-accurate.")
    _foot(page, f"Frame for a gray card of {width:g} x {height:g} mm; do not cut.")
    return page


def card_marker_places(width_mm: float, height_mm: float) -> tuple[Point, ...]:
    """Upper left corners of the frame's markers on a page of this size, in the ids' order."""
    far_x = width_mm - EDGE_MM - 4 - CARD_MARKER_EDGE_MM
    far_y = height_mm - EDGE_MM - _FOOT_MM - CARD_MARKER_EDGE_MM
    near = EDGE_MM + 4
    return ((near, near), (far_x, near), (far_x, far_y), (near, far_y))


def card_place(width_mm: float, height_mm: float) -> tuple[float, float, float, float]:
    """Where a card may lie on the frame: left, top, width, height."""
    upper_left, _, lower_right, _ = card_marker_places(width_mm, height_mm)
    left = upper_left[0] + CARD_MARKER_EDGE_MM + 8
    top = upper_left[1]
    bottom = lower_right[1] + CARD_MARKER_EDGE_MM
    return left, top, lower_right[0] - 8 - left, bottom - top


def _outline(page: Page, left: float, top: float, width: float, height: float) -> None:
    right, bottom = left + width, top + height
    page.fill(
        [
            rectangle(left, top - _LINE_MM / 2, width, _LINE_MM),
            rectangle(left, bottom - _LINE_MM / 2, width, _LINE_MM),
            rectangle(left - _LINE_MM / 2, top, _LINE_MM, height),
            rectangle(right - _LINE_MM / 2, top, _LINE_MM, height),
        ],
        GREY,
    )


def _foot(page: Page, words: str) -> None:
    """The scale to check the print with, and what this is."""
    top = page.height_mm - EDGE_MM
    left = EDGE_MM + 4
    ticks = [
        rectangle(left + at - _LINE_MM / 2, top - long, _LINE_MM, long)
        for at in range(0, SCALE_MM + 1, 10)
        for long in (4 if at % 50 == 0 else 2,)
    ]
    page.fill([rectangle(left, top - _LINE_MM / 2, SCALE_MM, _LINE_MM), *ticks])
    page.write((left + SCALE_MM + 4, top - 1.5), "100 mm: check with a ruler. If not, print again")
    page.write((left + SCALE_MM + 4, top + 2.5), 'at 100 %, without "fit to page".')
    page.write((left, top - 6), words)
