"""The floor before a camera: where on it a pixel lies, and what lies on it to tell its place."""

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np

from mbot_protocol.drive.camera_model import CameraModel
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.measure.calibration.camera.board_detection import find_board
from mbot_workstation.measure.targets.marker_detection import Grey
from mbot_workstation.measure.targets.specifications import Board
from mbot_workstation.measure.tracks.track import Array


@dataclass(frozen=True, slots=True, eq=False)
class FloorPlane:
    """A level plane below a camera, with a frame of its own: z up, origin straight below the
    camera, x to the right in the picture.

    Attributes:
        up: unit vector in the camera's frame (x right, y down, z ahead), shape (3,).
        distance_m: from the camera straight down.

    """

    up: Array
    distance_m: float

    @property
    def axes(self) -> Array:
        """The plane's x and y in the camera's frame. Shape (2, 3)."""
        right = np.array([1.0, 0.0, 0.0])
        x = right - (right @ self.up) * self.up
        x /= np.linalg.norm(x)
        return np.stack([x, np.cross(self.up, x)])

    def raised(self, height_m: float) -> "FloorPlane":
        """The plane so far above this one; its frame lies straight above."""
        return FloorPlane(self.up, self.distance_m - height_m)

    def places_m(self, rays: Array) -> Array:
        """Where rays from the camera meet the plane, in its frame. Shapes (..., 3), (..., 2).

        Rays that never meet it give places that are not finite.
        """
        falling = rays @ self.up
        with np.errstate(divide="ignore", invalid="ignore"):
            along = np.where(falling < 0, -self.distance_m / falling, np.nan)
        points = rays * along[..., None]
        return points @ self.axes.T


def pixel_rays(camera: CameraModel, pixels: Array) -> Array:
    """Directions in the camera's frame, 1 ahead. Shapes (..., 2), (..., 3)."""
    flat = pixels.reshape(-1, 1, 2)
    straight = cv2.undistortPoints(flat, camera.matrix, np.array(camera.distortion)).reshape(-1, 2)
    rays = np.concatenate([straight, np.ones((len(straight), 1))], axis=1)
    return rays.astype(np.float64).reshape(*pixels.shape[:-1], 3)


def plane_from_points(camera: CameraModel, points_m: Array, pixels: Array) -> FloorPlane | None:
    """The plane z = 0 of known points; None if no pose fits.

    Args:
        camera: that sees them.
        points_m: on the plane, shape (n, 2), n at least 4, any frame.
        pixels: where they are seen, shape (n, 2).

    """
    objects = np.concatenate([points_m, np.zeros((len(points_m), 1))], axis=1)
    solved, turned, moved = cv2.solvePnP(
        objects, pixels, camera.matrix, np.array(camera.distortion), flags=cv2.SOLVEPNP_ITERATIVE
    )
    if not solved:
        return None
    matrix, _ = cv2.Rodrigues(turned)
    normal, place = np.asarray(matrix)[:, 2], np.asarray(moved).ravel()
    # Up is towards the camera, whichever way the points' own z goes.
    distance_m = float(-normal @ place)
    return FloorPlane(normal * np.sign(distance_m), abs(distance_m)) if distance_m else None


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
