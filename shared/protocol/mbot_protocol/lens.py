"""What a lens's distortion does to rays, without OpenCV."""

import numpy as np
from numpy.typing import NDArray

from mbot_protocol.camera_model import CameraModel

STEPS = 400
"""Along the radius; a fold between two steps would be narrower than a pixel."""


def folds_within(camera: CameraModel) -> bool:
    """Whether the radial distortion folds the picture over, or never reaches its corners.

    A polynomial that was fitted to corners in the middle only may bend back further out. No
    undistortion is possible there.
    """
    k1, k2, _, _, k3 = camera.distortion
    if k1 == k2 == k3 == 0:
        return False
    corner = _corner(camera)
    # A ray that far out is 80 degrees off the axis: what is not reached by then never is.
    slopes: NDArray[np.float64] = np.linspace(0.0, 5.7, STEPS * 10)
    squared = slopes**2
    seen = slopes * (1 + squared * (k1 + squared * (k2 + squared * k3)))
    reached = int(np.argmax(seen >= corner))
    if seen[reached] < corner:
        return True
    return bool((np.diff(seen[: reached + 1]) <= 0).any())


def _corner(camera: CameraModel) -> float:
    """The largest distance from the axis in the picture, as a slope."""
    x = max(camera.principal_x_px + 0.5, camera.width_px - 0.5 - camera.principal_x_px)
    y = max(camera.principal_y_px + 0.5, camera.height_px - 0.5 - camera.principal_y_px)
    return float(np.hypot(x / camera.focal_x_px, y / camera.focal_y_px))
