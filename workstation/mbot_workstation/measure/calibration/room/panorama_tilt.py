"""How a 360-degree camera was tilted, from the upright edges of doors, walls and shelves.

Every straight edge lies in a plane through the camera, and the planes of all upright edges share
one line: the vertical.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from mbot_protocol.drive.picture import Picture
from mbot_workstation.measure.calibration.room.panorama_turn import look_at

Values = NDArray[np.float64]

VIEWS, VIEW_DEG, VIEW_PX = 8, 70.0, 480
"""Flat pictures all around in which edges are straight."""

LARGEST_TILT_DEG = 20.0
"""A camera on a tripod or a table; tilted by more, shelves and table tops look upright."""

SHORTEST_PX = 36
"""5 degrees: shorter edges have a direction of their own."""

AGREES_DEG = 0.6
"""How far the vertical may lie off an edge's plane: what lens, stitching and pixels leave."""

FEWEST_DEG = 120.0
"""Sum of the lengths of the edges that agree; a door is 30 degrees high."""

FEWEST_EDGES = 6

AMBIGUOUS = 0.75
"""When another vertical, 4 degrees or more away, has this share of the best one's votes, lamps and
slanted furniture may have outvoted the walls. Four real rooms have 0.3 to 0.6, turned up to 12
degrees; one full of lamps on stands 0.6 to 0.96, and was wrong by up to 3 degrees above 0.75."""

_ROUNDS = 8


@dataclass(frozen=True, slots=True)
class Tilt:
    """What the upright edges say.

    Attributes:
        vertical: unit vector in the photo's own directions, shape (3,).
        edges: how many agree on it.
        known_to_deg: standard deviation in its worse direction.

    """

    vertical: Values
    edges: int
    known_to_deg: float


def find_tilt(picture: Picture) -> Tilt | None:
    """The tilt; None if there are too few upright edges, or they don't agree.

    Args:
        picture: equirectangular, shape (h, 2 h, 3), RGB.

    """
    planes, lengths = _edges(picture)
    if len(planes) < FEWEST_EDGES:
        return None
    # Every tilt in turn, first in steps of a degree; then the best one by least squares.
    steps = np.radians(np.arange(-LARGEST_TILT_DEG, LARGEST_TILT_DEG + 0.5, 1.0))
    x, y = (axis.ravel() for axis in np.meshgrid(np.tan(steps), np.tan(steps)))
    tried = np.column_stack([x, y, np.ones(x.size)])
    tried /= np.linalg.norm(tried, axis=1, keepdims=True)
    width = np.sin(np.radians(2 * AGREES_DEG))
    votes = np.exp(-((planes @ tried.T / width) ** 2))
    counted = lengths @ votes
    vertical = tried[np.argmax(counted)]
    others = counted[tried @ vertical < np.cos(np.radians(4))]
    if others.max() > AMBIGUOUS * counted.max():
        return None
    for _ in range(_ROUNDS):
        off = planes @ vertical
        weights = lengths * np.exp(-((off / np.sin(np.radians(AGREES_DEG))) ** 2))
        axes = np.linalg.eigh((planes * weights[:, None]).T @ planes)[1]
        vertical = axes[:, 0] * np.sign(axes[2, 0])
    agrees = np.abs(planes @ vertical) < np.sin(np.radians(AGREES_DEG))
    if agrees.sum() < FEWEST_EDGES or lengths[agrees].sum() < FEWEST_DEG:
        return None
    # How well the planes' normals, all level, fix both ways it could lean.
    scatter = (planes[agrees] * lengths[agrees, None]).T @ planes[agrees]
    weakest = float(np.linalg.eigvalsh(scatter)[1])
    error = np.sqrt(np.average((planes[agrees] @ vertical) ** 2, weights=lengths[agrees]))
    error = max(float(error), np.radians(0.1))
    known = float(np.degrees(error * np.sqrt(lengths[agrees].max() / weakest)))
    return Tilt(vertical, int(agrees.sum()), known)


def _edges(picture: Picture) -> tuple[Values, Values]:
    """Steep straight edges all around: normals of their planes, shape (n, 3); degrees, (n,)."""
    focal = VIEW_PX / 2 / np.tan(np.radians(VIEW_DEG) / 2)
    rows, columns = np.indices((VIEW_PX, VIEW_PX)).astype(np.float64)
    ahead = np.stack(
        [
            np.full((VIEW_PX, VIEW_PX), focal),
            (VIEW_PX - 1) / 2 - columns,
            (VIEW_PX - 1) / 2 - rows,
        ],
        axis=-1,
    )
    detector = cv2.createLineSegmentDetector()
    planes: list[Values] = []
    lengths: list[float] = []
    for number in range(VIEWS):
        yaw = 2 * np.pi * number / VIEWS
        turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
        view = look_at(picture, ahead @ turn.T)
        found = detector.detect(cv2.cvtColor(view, cv2.COLOR_RGB2GRAY))[0]
        for x1, y1, x2, y2 in np.zeros((0, 4)) if found is None else found.reshape(-1, 4):
            long = np.hypot(x2 - x1, y2 - y1)
            steep = abs(y2 - y1) > 2.2 * abs(x2 - x1)  # within 24 degrees of upright
            # Views overlap, as views of 45 degrees side by side would cut edges.
            middle = abs((x1 + x2) / 2 - VIEW_PX / 2) < focal * np.tan(np.pi / VIEWS)
            if long < SHORTEST_PX or not steep or not middle:
                continue
            ends = np.array(
                [
                    (focal, (VIEW_PX - 1) / 2 - x, (VIEW_PX - 1) / 2 - y)
                    for x, y in ((x1, y1), (x2, y2))
                ]
            )
            ends /= np.linalg.norm(ends, axis=1, keepdims=True)
            normal = np.cross(ends[0], ends[1])
            planes.append(turn @ normal / np.linalg.norm(normal))
            lengths.append(float(np.degrees(np.arcsin(np.linalg.norm(normal)))))
    return np.array(planes).reshape(-1, 3), np.array(lengths)
