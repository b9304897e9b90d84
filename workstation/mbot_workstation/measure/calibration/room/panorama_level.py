"""How a 360-degree camera was tilted, and its photo made level and turned.

Upright edges of doors, walls and shelves tell the tilt: every straight edge lies in a plane through
the camera, and the planes of all upright edges share one line, the vertical.
"""

from dataclasses import dataclass
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from mbot_protocol.drive.picture import Picture

Values = NDArray[np.float64]
"""Directions: x towards the photo's middle, y to its left, z up."""


def directions(width_px: int) -> Values:
    """Where each pixel of a panorama looks. Shape (width_px / 2, width_px, 3), unit vectors."""
    height_px = width_px // 2
    yaw = np.pi * (1 - 2 * (np.arange(width_px) + 0.5) / width_px)
    elevation = np.pi * (0.5 - (np.arange(height_px) + 0.5) / height_px)
    flat = np.cos(elevation)[:, None]
    return np.stack(
        [
            flat * np.cos(yaw),
            flat * np.sin(yaw),
            np.broadcast_to(np.sin(elevation)[:, None], (height_px, width_px)),
        ],
        axis=-1,
    )


def look_at(picture: Picture, where: Values) -> Picture:
    """Sample a panorama.

    Args:
        picture: equirectangular, shape (h, 2 h, 3).
        where: directions, shape (..., 3), of any length; two axes before the last.

    Returns:
        Shape (..., 3), uint8.

    """
    height, width = picture.shape[:2]
    yaw = np.arctan2(where[..., 1], where[..., 0])
    elevation = np.arctan2(where[..., 2], np.hypot(where[..., 0], where[..., 1]))
    margin = 2
    wrapped = cv2.copyMakeBorder(picture, 0, 0, margin, margin, cv2.BORDER_WRAP)
    columns = (1 - yaw / np.pi) * width / 2 - 0.5 + margin
    rows = (0.5 - elevation / np.pi) * height - 0.5
    return cast(
        Picture,
        cv2.remap(
            wrapped,
            columns.astype(np.float32),
            rows.astype(np.float32),
            cv2.INTER_CUBIC,
            borderMode=cv2.BORDER_REPLICATE,
        ),
    )


def camera_tilt(pitch_deg: float, roll_deg: float) -> Values:
    """The rotation from a tilted camera's directions to level ones. Shape (3, 3).

    Args:
        pitch_deg: how far the middle of its photo is above the horizon.
        roll_deg: how far the camera was turned clockwise, as seen from behind.

    """
    pitch, roll = np.radians([pitch_deg, roll_deg])
    up = np.array(
        [[np.cos(pitch), 0, -np.sin(pitch)], [0, 1, 0], [np.sin(pitch), 0, np.cos(pitch)]]
    )
    around = np.array(
        [[1, 0, 0], [0, np.cos(roll), -np.sin(roll)], [0, np.sin(roll), np.cos(roll)]]
    )
    return up @ around


def tilt_of(vertical: Values) -> tuple[float, float]:
    """Pitch and roll in degrees of a camera whose photo has the vertical there, shape (3,)."""
    x, y, z = vertical / np.linalg.norm(vertical)
    return float(np.degrees(np.arcsin(x))), float(np.degrees(np.arctan2(y, z)))


def level(
    picture: Picture, width_px: int, pitch_deg: float, roll_deg: float, heading_deg: float
) -> Picture:
    """A level panorama of another size.

    Args:
        picture: shape (h, 2 h, 3).
        width_px: of the result.
        pitch_deg, roll_deg: of the camera that took it, see `camera_tilt`.
        heading_deg: what is so far to the right of the middle comes into the middle.

    """
    if width_px < picture.shape[1]:
        size = (width_px, width_px // 2)
        picture = cast(Picture, cv2.resize(picture, size, interpolation=cv2.INTER_AREA))
    turn = np.radians(-heading_deg)
    about = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    back = camera_tilt(pitch_deg, roll_deg).T @ about
    if picture.shape[1] == width_px and np.allclose(back, np.eye(3)):
        return picture
    return look_at(picture, directions(width_px) @ back.T)


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
