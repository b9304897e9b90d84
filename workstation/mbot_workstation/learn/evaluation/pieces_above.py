"""What a task has put into its arena, drawn from above."""

import math
from collections.abc import Callable, Sequence

import cv2
import numpy as np

from mbot_protocol.drive.picture import Picture
from mbot_workstation.sim.scene.scene_look import Distractor


def draw_pieces(
    area: Picture, pieces: Sequence[Distractor], at: Callable[[float, float], tuple[int, int]]
) -> None:
    """Draw their outlines, filled.

    Args:
        area: drawn upon, RGB.
        pieces: in the arena's frame.
        at: column and row of a place, x and y in metres.

    """
    for piece in pieces:
        colour = tuple(round(255 * part) for part in piece.rgb)
        corners = np.array([at(*corner) for corner in _corners(piece)], np.int32)
        cv2.fillPoly(area, [corners], colour)
        cv2.polylines(area, [corners], isClosed=True, color=colour)  # also what is thin


def _corners(piece: Distractor) -> list[tuple[float, float]]:
    """Of a box from above, or of a polygon about what is round; a tilt changes nothing here."""
    x_m, y_m, _ = piece.centre_m
    half_x, half_y, _ = piece.half_size_m
    if piece.shape == "box":
        around = [(half_x, half_y), (-half_x, half_y), (-half_x, -half_y), (half_x, -half_y)]
    else:
        half_y = half_x if piece.shape in ("ball", "post") else half_y
        turns = np.linspace(0, 2 * np.pi, 12, endpoint=False).tolist()
        around = [(half_x * math.cos(turn), half_y * math.sin(turn)) for turn in turns]
    cos, sin = math.cos(piece.yaw_rad), math.sin(piece.yaw_rad)
    return [(x_m + cos * x - sin * y, y_m + sin * x + cos * y) for x, y in around]
