"""The robot's path from above, drawn from a trajectory file."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from mbot_protocol.drive.picture import Picture
from mbot_workstation.pictures.film_tile import write

BACKGROUND, GRID, BORDER = (250, 250, 248), (228, 228, 224), (120, 120, 120)
PATH, START = (30, 90, 200), (20, 130, 60)
RED = (200, 30, 35)
"""The paper's cube, where a file of before says no colour."""

OPEN_SHARE = 0.35
"""Of an object's colour, where it was not touched."""

BORDER_M = 2.9
MARGIN_M = 0.2
CUBE_M = 0.10
LETTERS, WORD_PX = 0.45, (20, 12)
"""Size of the numbers, and how much place one of two digits takes."""

JUMP_M = 0.3
"""A longer step between two points is the robot being put back: no line is drawn."""


@dataclass(frozen=True, slots=True)
class ObjectLain:
    """Where an object lay, whether it was touched, and its colour, 0-255."""

    x_m: float
    y_m: float
    touched: bool
    rgb: tuple[int, int, int] = RED


@dataclass(frozen=True, slots=True)
class Trajectory:
    """A trajectory file: path and objects in metres.

    Attributes:
        path: shape (n, 2).
        objects: in order.

    """

    path: np.ndarray
    objects: list[ObjectLain]


def read_trajectory(path: Path) -> Trajectory:
    """Read what `workstation virtual-robot --trajectory` wrote."""
    points: list[tuple[float, float]] = []
    objects: list[ObjectLain] = []
    current: ObjectLain | None = None
    for line in path.read_text().splitlines():
        entry = json.loads(line)
        if "event" in entry:
            if current is not None:
                objects.append(replace(current, touched=entry["event"] == "touch"))
                current = None
            continue
        points.append((entry["x"], entry["y"]))
        x_m, y_m, _ = entry["object"]
        red, green, blue = entry.get("colour", RED)
        current = ObjectLain(x_m, y_m, touched=False, rgb=(red, green, blue))
    if current is not None:
        objects.append(current)
    return Trajectory(np.array(points).reshape(-1, 2), objects)


def draw_path(trajectory: Trajectory, side_px: int) -> Picture:
    """Draw it: +x to the right, +y up, a line every metre. Shape (side_px, side_px, 3), RGB."""
    half_m = BORDER_M + MARGIN_M
    scale = side_px / (2 * half_m)

    def pixel(x_m: float, y_m: float) -> tuple[int, int]:
        return round((half_m + x_m) * scale), round((half_m - y_m) * scale)

    picture = np.full((side_px, side_px, 3), BACKGROUND, np.uint8)
    for metre in range(-2, 3):
        cv2.line(picture, pixel(metre, -BORDER_M), pixel(metre, BORDER_M), GRID, 1)
        cv2.line(picture, pixel(-BORDER_M, metre), pixel(BORDER_M, metre), GRID, 1)
    cv2.rectangle(picture, pixel(-BORDER_M, BORDER_M), pixel(BORDER_M, -BORDER_M), BORDER, 2)
    for before, after in zip(trajectory.path, trajectory.path[1:], strict=False):
        if np.hypot(*(after - before)) < JUMP_M:
            cv2.line(picture, pixel(*before), pixel(*after), PATH, 2, cv2.LINE_AA)
    edge_px = max(4, round(CUBE_M * scale))
    labels: list[tuple[int, int]] = []
    for number, lain in enumerate(trajectory.objects, 1):
        column, row = pixel(lain.x_m, lain.y_m)
        corner = (column - edge_px // 2, row - edge_px // 2)
        opposite = (column + edge_px // 2, row + edge_px // 2)
        share = 1.0 if lain.touched else OPEN_SHARE
        mixed = share * np.array(lain.rgb) + (1 - share) * np.array(BACKGROUND)
        cv2.rectangle(picture, corner, opposite, mixed.round().tolist(), -1)
        cv2.rectangle(picture, corner, opposite, BORDER, 1)  # a white one is seen, too
        label = _free_corner(column, row, edge_px, labels)
        labels.append(label)
        write(picture, str(number), label, BORDER, LETTERS)
    cv2.circle(picture, pixel(0, 0), 5, START, -1, cv2.LINE_AA)
    legend = "green: start, at the middle; pale: not touched"
    write(picture, legend, (6, side_px - 5), BORDER, LETTERS * 0.85)
    return picture


def _free_corner(
    column: int, row: int, edge_px: int, taken: Sequence[tuple[int, int]]
) -> tuple[int, int]:
    """Where an object's number goes, its lower left corner: beside it, on no other number."""
    right, left, above, below = column + edge_px, column - edge_px - WORD_PX[0], row, row + 14
    corners = [(right, above), (left, above), (right, below + 6), (left, below + 6)]
    for x, y in corners:
        if all(abs(x - u) >= WORD_PX[0] or abs(y - v) >= WORD_PX[1] for u, v in taken):
            return x, y
    return corners[0]
