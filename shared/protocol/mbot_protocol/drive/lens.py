"""What a lens's distortion does to rays, without OpenCV."""

import math

import numpy as np
from numpy.typing import NDArray

from mbot_protocol.drive.camera_model import CameraModel
from mbot_protocol.policy.policy_contract import FieldOfView

OUTERMOST = 5.7
"""A ray of this slope is 80 degrees off the axis: what is not reached by then never is."""

STEPS = 400
"""Along the radius; a fold between two steps would be narrower than a pixel."""


def folds_within(camera: CameraModel) -> bool:
    """Whether the radial distortion folds the picture over, or never reaches its corners.

    A polynomial that was fitted to corners in the middle only may bend back further out. No
    undistortion is possible there.
    """
    return _folds(camera, OUTERMOST)


def folds_in_view(camera: CameraModel, view: FieldOfView) -> bool:
    """Whether it does so in the part of the picture that a policy with this view looks at.

    What lies beyond is cut off before anything is undistorted.
    """
    across, up = (
        math.tan(math.radians(deg) / 2) for deg in (view.horizontal_deg, view.vertical_deg)
    )
    return _folds(camera, math.hypot(across, up))


def _folds(camera: CameraModel, outermost: float) -> bool:
    corner = _corner(camera)
    slopes: NDArray[np.float64] = np.linspace(0.0, outermost, STEPS * 10)
    seen = _seen(camera, slopes)
    if seen is slopes:
        return False
    if not np.isfinite(seen).all():
        return True
    if outermost < OUTERMOST and seen.max() < corner:
        return bool((np.diff(seen) <= 0).any())
    reached = int(np.argmax(seen >= corner))
    if seen[reached] < corner:
        return True
    return bool((np.diff(seen[: reached + 1]) <= 0).any())


def ray_slope(camera: CameraModel, seen: float) -> float:
    """The slope of the ray that appears so far from the axis, in focal lengths.

    Where the distortion folds before, the outermost that appears at all.
    """
    slopes: NDArray[np.float64] = np.linspace(0.0, OUTERMOST, STEPS * 10)
    places = _seen(camera, slopes)
    if places is slopes:
        return seen
    rises = places[1:] > places[:-1]
    until = len(slopes) if rises.all() else int(np.argmin(rises)) + 1
    return float(np.interp(seen, places[:until], slopes[:until]))


def _seen(camera: CameraModel, slopes: NDArray[np.float64]) -> NDArray[np.float64]:
    """How far from the axis rays of these slopes appear; infinite where nothing does. The same
    array without any radial distortion."""
    k1, k2, _, _, k3, k4, k5, k6 = (*camera.distortion, 0.0, 0.0, 0.0)[:8]
    if not any((k1, k2, k3, k4, k5, k6)):
        return slopes
    squared = slopes**2
    above = 1 + squared * (k1 + squared * (k2 + squared * k3))
    below = 1 + squared * (k4 + squared * (k5 + squared * k6))
    return np.where(below > 0, slopes * above / np.where(below > 0, below, 1.0), -np.inf)


def _corner(camera: CameraModel) -> float:
    """The largest distance from the axis in the picture, as a slope."""
    x = max(camera.principal_x_px + 0.5, camera.width_px - 0.5 - camera.principal_x_px)
    y = max(camera.principal_y_px + 0.5, camera.height_px - 0.5 - camera.principal_y_px)
    return float(np.hypot(x / camera.focal_x_px, y / camera.focal_y_px))
