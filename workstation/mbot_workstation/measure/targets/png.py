"""A page as a PNG that knows its own size in millimetres."""

from io import BytesIO

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from mbot_workstation.measure.targets.sheet import Page

DOTS_A_MM = 300 / 25.4
"""300 dots an inch: the edge of a cell of a marker is within 0.04 mm, less than paper moves."""

_SHIFT = 8
"""Bits after the point in the coordinates that OpenCV fills polygons with."""


def draw(page: Page, dots_a_mm: float = DOTS_A_MM) -> NDArray[np.uint8]:
    """The page as a grey picture. Shape (height, width)."""
    size = round(page.height_mm * dots_a_mm), round(page.width_mm * dots_a_mm)
    picture = np.full(size, 255, np.uint8)
    for shape in page.shapes:
        for polygon in shape.polygons:
            # OpenCV counts from the middle of a dot and fills the last one too.
            corners = (np.array(polygon) * dots_a_mm - 0.5) * 2**_SHIFT
            inner = corners + np.sign(corners.mean(axis=0) - corners) * 2 ** (_SHIFT - 1)
            level = round(255 * shape.grey)
            cv2.fillPoly(picture, [np.round(inner).astype(np.int32)], level, shift=_SHIFT)
    for text in page.texts:
        at = round(text.at[0] * dots_a_mm), round(text.at[1] * dots_a_mm)
        scale = text.size_mm * dots_a_mm / 34  # of OpenCV's letters, which are this high at 1
        thick = max(1, round(0.12 * text.size_mm * dots_a_mm))
        font = cv2.FONT_HERSHEY_SIMPLEX
        cv2.putText(picture, text.words, at, font, scale, 0, thick, cv2.LINE_AA)
    return picture


def to_png(page: Page) -> bytes:
    """The page as the bytes of a PNG file with its dots per metre in it."""
    file = BytesIO()
    dots_an_inch = DOTS_A_MM * 25.4
    Image.fromarray(draw(page)).save(file, "PNG", dpi=(dots_an_inch, dots_an_inch))
    return file.getvalue()
