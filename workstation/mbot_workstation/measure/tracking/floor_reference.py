"""What may lie on the floor to tell where it is: four markers at known distances, or a board."""

from collections.abc import Mapping

import numpy as np

from mbot_protocol.drive.camera_model import CameraModel
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.measure.calibration.camera.board_detection import find_board
from mbot_workstation.measure.targets.specifications import Board
from mbot_workstation.measure.tracking.floor_plane import FloorPlane, plane_from_points
from mbot_workstation.measure.tracking.marker_detection import Grey
from mbot_workstation.measure.tracking.marker_watch import FindFloor
from mbot_workstation.sim.track import Array

CORNER_IDS = (1, 2, 3, 4)
"""Printed by `workstation print marker --id 1` and so on; clockwise, seen from above."""


def plane_from_corners(
    camera: CameraModel, markers: Mapping[int, Array], width_m: float, depth_m: float
) -> FloorPlane | None:
    """The floor from four markers at a rectangle's corners; None if not all are in view.

    Args:
        camera: that sees them.
        markers: corners of every marker in view, in pixels, shape (4, 2) each.
        width_m: between the centres of 1 and 2, and of 4 and 3.
        depth_m: between the centres of 2 and 3, and of 1 and 4.

    Raises:
        ConfigurationError: they are not clockwise, or no rectangle.

    """
    if not all(number in markers for number in CORNER_IDS):
        return None
    pixels = np.stack([markers[number].mean(axis=0) for number in CORNER_IDS])
    sides = np.roll(pixels, -1, axis=0) - pixels
    turns = sides[:, 0] * np.roll(sides[:, 1], -1) - sides[:, 1] * np.roll(sides[:, 0], -1)
    if not (turns > 0).all():
        raise ConfigurationError(
            "the markers 1, 2, 3 and 4 on the floor are not clockwise around a rectangle; lay them "
            "in this order"
        )
    points_m = np.array([[0, 0], [width_m, 0], [width_m, -depth_m], [0, -depth_m]], np.float64)
    return plane_from_points(camera, points_m, pixels)


def plane_from_board(camera: CameraModel, picture: Grey, square_mm: float) -> FloorPlane | None:
    """The floor from the printed ChArUco board lying on it; None if it is not in view.

    The picture is grey, shape (h, w).
    """
    found = find_board(picture, Board(square_mm=square_mm, charuco=True))
    if found is None:
        return None
    points = found.points_m[:, :2].astype(np.float64) * [1, -1]
    return plane_from_points(camera, points, found.corners_px.astype(np.float64))


def floor_finder(corners_m: tuple[float, float] | None, board_mm: float | None) -> FindFloor | None:
    """What finds the floor by markers at a rectangle's corners, or by a board; None by neither."""
    if corners_m is not None:
        return lambda camera, _grey, markers: plane_from_corners(camera, markers, *corners_m)
    if board_mm is not None:
        return lambda camera, grey, _markers: plane_from_board(camera, grey, board_mm)
    return None
