"""A picture in a terminal: each character is two pixels, one above the other."""

import cv2
import numpy as np
from rich.color import Color
from rich.style import Style
from rich.text import Text

from mbot_protocol.drive.picture import Picture

UPPER_HALF = "▀"


def half_blocks(picture: Picture, columns: int) -> Text:
    """The picture, `columns` characters wide and half as many lines high if it is square.

    Args:
        picture: shape (height, width, 3), uint8, RGB.
        columns: width in characters, at least 1.

    """
    height_px, width_px = picture.shape[:2]
    lines = max(1, round(columns * height_px / width_px / 2))
    small = cv2.resize(picture, (columns, 2 * lines), interpolation=cv2.INTER_AREA)
    text = Text(no_wrap=True)
    for line in range(lines):
        if line:
            text.append("\n")
        for upper, lower in zip(small[2 * line], small[2 * line + 1], strict=True):
            text.append(UPPER_HALF, Style(color=_color(upper), bgcolor=_color(lower)))
    return text


def _color(pixel: np.ndarray) -> Color:
    red, green, blue = (int(value) for value in pixel)
    return Color.from_rgb(red, green, blue)
