"""The model of a camera overhead: calibrated, or guessed from its field of view."""

import math
from collections.abc import Callable
from pathlib import Path

from mbot_protocol.drive.calibration import CAMERA_FILE, read_camera
from mbot_protocol.drive.camera_model import CameraModel
from mbot_protocol.errors import ConfigurationError

MOST_STRETCH = 0.02
"""By which a picture's shape may differ from the calibration's."""


def camera_for(folder: Path | None, fov_deg: float) -> Callable[[int, int], CameraModel]:
    """What gives a camera's model for pictures of some width and height, in pixels.

    Args:
        folder: of its calibration; None if it has none.
        fov_deg: its horizontal field of view then, roughly.

    Raises:
        ConfigurationError: the folder holds no camera; later, of pictures of another shape.

    """
    if folder is None:

        def guessed(width_px: int, height_px: int) -> CameraModel:
            half = math.tan(math.radians(fov_deg) / 2) * height_px / width_px
            up_deg = math.degrees(2 * math.atan(half))
            return CameraModel.from_field_of_view(width_px, height_px, fov_deg, up_deg)

        return guessed
    calibrated = read_camera(folder)
    if calibrated is None:
        raise ConfigurationError(f"{folder} holds no {CAMERA_FILE}")
    model = calibrated.model()

    def scaled(width_px: int, height_px: int) -> CameraModel:
        if abs(width_px * model.height_px / (height_px * model.width_px) - 1) > MOST_STRETCH:
            raise ConfigurationError(
                f"pictures are {width_px} x {height_px}, {folder / CAMERA_FILE} is for "
                f"{model.width_px} x {model.height_px}, another shape"
            )
        return model.scaled_to(width_px, height_px)

    return scaled
