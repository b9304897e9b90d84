"""Photographs of a printed page through the true lens: a ray for every pixel, hence exact."""

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from mbot_protocol.drive.camera_model import CameraModel
from mbot_protocol.drive.picture import Picture
from mbot_workstation.sim.camera.sensor_noise import SensorNoise
from mbot_workstation.sim.track import Array

FINER = 2
"""Rays a pixel along each side, averaged: the pixel's own area."""

BLUR_PX = 0.5
"""Standard deviation of a good lens in focus."""

BEHIND_PAGE = 0.30
"""Level of what is around the page: a wall out of focus."""


@dataclass(frozen=True, slots=True, eq=False)
class Sheet:
    """A printed page as a picture: ink, paper and gray cards have no colour of their own.

    Attributes:
        picture: levels in [0, 1], float32, shape (h, w).
        dots_a_mm: its scale.

    """

    picture: NDArray[np.float32]
    dots_a_mm: float

    @property
    def middle_mm(self) -> tuple[float, float]:
        """From the upper left corner."""
        height, width = self.picture.shape
        return width / self.dots_a_mm / 2, height / self.dots_a_mm / 2


@dataclass(frozen=True, slots=True)
class Hold:
    """How the page is held before the camera, in OpenCV's camera frame.

    Attributes:
        turn: rotation vector, page to camera; the page's x is to the right, y down, z into it.
        at_m: of the page's middle.

    """

    turn: tuple[float, float, float]
    at_m: tuple[float, float, float]

    @property
    def rotation(self) -> Array:
        """As a matrix, shape (3, 3)."""
        return np.asarray(cv2.Rodrigues(np.array(self.turn))[0], dtype=np.float64)


def photograph(
    sheet: Sheet, camera: CameraModel, hold: Hold, light: Array, noise: SensorNoise
) -> Picture:
    """Take one.

    Args:
        sheet: the page.
        camera: size and lens.
        hold: where the page is.
        light: levels by which the page's are multiplied, of red, green and blue; shape (3,).
        noise: of a sensor of that size.

    Returns:
        Shape (height_px, width_px, 3), RGB.

    """
    rays = _rays(camera)
    rotation = hold.rotation
    to_rays = np.column_stack([rotation[:, 0], rotation[:, 1], np.array(hold.at_m) * 1000])
    across, down = sheet.middle_mm
    # From millimetres on the page to its dots; the middle of the first is 0, 0.
    dots = sheet.dots_a_mm
    to_dots = np.array([[dots, 0, across * dots - 0.5], [0, dots, down * dots - 0.5], [0, 0, 1]])
    where = cv2.transform(rays, (to_dots @ np.linalg.inv(to_rays)).astype(np.float32))
    columns, rows, depth = (np.asarray(one, np.float32) for one in cv2.split(where))
    depth[depth <= 0] = 1e-9  # behind the camera, so far off the page
    drawn = cv2.remap(
        sheet.picture,
        columns / depth,
        rows / depth,
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=(BEHIND_PAGE,),
    )
    size = camera.width_px, camera.height_px
    grey = cv2.resize(drawn, size, interpolation=cv2.INTER_AREA)
    grey = cv2.GaussianBlur(grey, (0, 0), BLUR_PX)
    sharp = (255 * grey[..., None] * light + 0.5).clip(0, 255).astype(np.uint8)
    return noise.apply(sharp)


@cache
def _rays(camera: CameraModel) -> NDArray[np.float32]:
    """The ray of each fine pixel as x / z, y / z, 1. Shape (rows, columns, 3)."""
    fine = camera.scaled_to(camera.width_px * FINER, camera.height_px * FINER)
    rows, columns = np.mgrid[0 : fine.height_px, 0 : fine.width_px].astype(np.float32)
    pixels = np.stack([columns.ravel(), rows.ravel()], axis=-1).reshape(-1, 1, 2)
    exact = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 30, 1e-9)
    slopes = cv2.undistortPoints(pixels, fine.matrix, np.array(fine.distortion), criteria=exact)
    flat = np.asarray(slopes, np.float32).reshape(fine.height_px, fine.width_px, 2)
    return np.concatenate([flat, np.ones_like(flat[..., :1])], axis=-1)
