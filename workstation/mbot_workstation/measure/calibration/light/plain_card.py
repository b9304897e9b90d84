"""Finds a gray card that lies somewhere in a photograph, without a frame."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from mbot_protocol.drive.picture import Picture
from mbot_protocol.errors import ConfigurationError

LOOKED_AT_PX = 640
SMALLEST_SHARE, LARGEST_SHARE = 0.004, 0.5
"""Of the picture's area."""

EVEN_BELOW = 10
"""Levels between neighbouring pixels, after smoothing; less is the card's own surface."""

FULL_SHARE = 0.86
"""Of the area within its outline: a rectangle seen at a slant is full, an odd shape is not."""

NARROWEST = 0.3
"""Short side against long one."""

MOST_COLOUR = 0.45
"""A gray card under a lamp: its channels differ by less than this of the brightest."""

DARKEST = 6.0

NEXT_BEST = 0.4
"""Of the largest one's area: a second rectangle of that size could be meant as well."""

_SEARCH_HELP = "or say where it is with --card X,Y,WIDTH,HEIGHT"


@dataclass(frozen=True, slots=True)
class _Candidate:
    area_px: float
    outline_px: NDArray[np.float64]


def find_plain_card(picture: Picture, name: str) -> NDArray[np.float64]:
    """The one even, colourless rectangle in a picture.

    Args:
        picture: RGB.
        name: of the photograph, for messages.

    Returns:
        Its corners, shape (4, 2), in pixels.

    Raises:
        ConfigurationError: there is none, or more than one.

    """
    share = min(1.0, LOOKED_AT_PX / max(picture.shape))
    small = np.asarray(
        cv2.resize(picture, None, fx=share, fy=share, interpolation=cv2.INTER_AREA), np.uint8
    )
    found = sorted(_candidates(small), key=lambda one: -one.area_px)
    if not found:
        raise ConfigurationError(
            f"{name}: no gray card found, expected one even, gray rectangle all in view; put it in "
            f"the frame of `workstation print gray-card`, {_SEARCH_HELP}"
        )
    if len(found) > 1 and found[1].area_px > NEXT_BEST * found[0].area_px:
        raise ConfigurationError(
            f"{name}: {len(found)} rectangles could be the gray card; put it in the frame of "
            f"`workstation print gray-card`, {_SEARCH_HELP}"
        )
    return (found[0].outline_px + 0.5) / share - 0.5


def _candidates(picture: Picture) -> list[_Candidate]:
    soft = cv2.bilateralFilter(picture, 7, 18, 5)
    block = np.ones((3, 3), np.uint8)
    steps = cv2.morphologyEx(soft, cv2.MORPH_GRADIENT, block).max(axis=2)
    even = cv2.erode((steps < EVEN_BELOW).astype(np.uint8), block)
    # Two levels: outlines of areas, also of those within others, and below them their holes.
    contours, levels = cv2.findContours(even, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
    if not contours:
        return []
    parents = np.asarray(levels, np.intp).reshape(-1, 4)[:, 3]
    found = [
        _candidate(np.asarray(contour, np.int32), picture)
        for contour, parent in zip(contours, parents, strict=True)
        if parent < 0
    ]
    return [candidate for candidate in found if candidate is not None]


def _candidate(contour: NDArray[np.int32], picture: Picture) -> _Candidate | None:
    """The rectangle an even area is; None if it is none, or coloured."""
    height, width = picture.shape[:2]
    area = float(cv2.contourArea(contour))
    if not SMALLEST_SHARE < area / (width * height) < LARGEST_SHARE:
        return None
    left, top, wide, high = cv2.boundingRect(contour)
    if left <= 2 or top <= 2 or left + wide >= width - 2 or top + high >= height - 2:
        return None
    outline = cv2.approxPolyDP(contour, 0.04 * cv2.arcLength(contour, True), True)
    if len(outline) != 4 or area < FULL_SHARE * cv2.contourArea(cv2.convexHull(contour)):
        return None
    sides = cv2.minAreaRect(contour)[1]
    if min(sides) < NARROWEST * max(sides):
        return None
    mask = np.zeros((height, width), np.uint8)
    cv2.drawContours(mask, [contour], -1, 1, cv2.FILLED)
    mean = np.array(cv2.mean(picture, mask)[:3])
    if np.ptp(mean) > MOST_COLOUR * mean.max() or mean.mean() < DARKEST:
        return None
    return _Candidate(area, np.asarray(outline, np.float64).reshape(4, 2))
