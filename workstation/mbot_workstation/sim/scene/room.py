"""The room behind the arena: a user's own 360-degree photo, or a generated one."""

from pathlib import Path
from typing import cast

import cv2

from mbot_protocol.drive.picture import Picture
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.pictures.picture_file import read_picture

LARGEST_WIDTH_PX = 4096
"""11 pixels a degree, twice what a 320 pixels wide picture of 55.3 degrees shows."""

ASPECT_TOLERANCE = 0.04
"""Cameras crop a few rows; a common flat photo (4:3, 3:2, 16:9) is far outside."""

SMALLEST_WIDTH_PX = 64


def load_room(path: Path) -> Picture:
    """Read an equirectangular photo: 360 degrees wide, 180 degrees high.

    Args:
        path: a PNG or JPEG file.

    Returns:
        Shape (h, 2 h, 3), RGB, h at most 2048.

    Raises:
        ConfigurationError: it can't be read, or is not twice as wide as it is high.

    """
    try:
        picture = read_picture(path, turn=True)
    except ConfigurationError as error:
        raise ConfigurationError(f"panorama: {error}") from None
    height, width = picture.shape[:2]
    if width < SMALLEST_WIDTH_PX or abs(width / height - 2) > 2 * ASPECT_TOLERANCE:
        raise ConfigurationError(
            f"panorama {path} is {width} x {height}; a 360-degree photo (equirectangular) is twice "
            f"as wide as high and at least {SMALLEST_WIDTH_PX} wide: export it from the camera's "
            "app as a full panorama, or leave the option out for a generated room"
        )
    return fit_room(picture)


def fit_room(picture: Picture, width_px: int | None = None) -> Picture:
    """Bring a panorama to exactly 2:1.

    Args:
        picture: shape (h, w, 3), RGB, about 2:1.
        width_px: the width to give it; its own, but at most LARGEST_WIDTH_PX, when None. Always
            rounded to a multiple of 4, since OpenGL reads texture rows in words.

    """
    width = (width_px or min(picture.shape[1], LARGEST_WIDTH_PX)) // 4 * 4
    if picture.shape[:2] == (width // 2, width):
        return picture
    shrinks = width < picture.shape[1]
    method = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    return cast(Picture, cv2.resize(picture, (width, width // 2), interpolation=method))
