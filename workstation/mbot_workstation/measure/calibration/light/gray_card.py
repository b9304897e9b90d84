"""Finds a gray card in a photograph: its colour, and how it is turned if it lies in its frame."""

from dataclasses import dataclass
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from mbot_protocol.drive.camera_model import CameraModel
from mbot_protocol.drive.picture import Picture
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.measure.calibration.light.card_outline import (
    find_framed_card,
    find_plain_card,
)

INNER_SHARE = 0.6
"""Of the card's edges: what is measured keeps away from fingers, edges and the frame."""

DARKEST, BRIGHTEST = 6.0, 249.0
"""Mean levels outside of which a channel is cut off, and says nothing."""

MOST_UNEVEN = 0.12
"""Spread of brightness over the card against its mean; a shadow's edge or a glare is beyond."""

Rectangle = tuple[int, int, int, int]
"""Left, top, width and height in pixels."""


@dataclass(frozen=True, slots=True)
class CardReading:
    """A gray card in one photograph.

    Attributes:
        name: of the photograph.
        rgb: mean levels, shape (3,), 0 to 255.
        outline_px: what was measured, corners in the picture, shape (4, 2).
        white, black: mean levels of the other patches of a three-patch card, shape (3,); None on
            a plain one.
        normal: unit vector out of the card in OpenCV's camera frame, shape (3,): x right, y down,
            z away from the camera; None where the frame's markers are not in view.

    """

    name: str
    rgb: NDArray[np.float64]
    outline_px: NDArray[np.float64]
    normal: NDArray[np.float64] | None
    white: NDArray[np.float64] | None = None
    black: NDArray[np.float64] | None = None


def read_card(
    picture: Picture,
    name: str,
    camera: CameraModel,
    card_mm: tuple[float, float],
    rectangle: Rectangle | None = None,
    *,
    three_patches: bool = False,
) -> CardReading:
    """Find the card and measure it.

    Args:
        picture: RGB.
        name: for messages.
        camera: at the picture's size.
        card_mm: width and height of the card in its frame.
        rectangle: where the card is; found by itself if None.
        three_patches: the card is white, gray and black side by side.

    Raises:
        ConfigurationError: no card is found, or it is too dark, too bright or not evenly lit.

    """
    framed = find_framed_card(picture, camera, card_mm)
    normal = None if framed is None else framed.normal
    if rectangle is not None:
        outline = _corners(rectangle, picture, name)
    elif framed is not None:
        outline = framed.outline_px
    else:
        outline = find_plain_card(picture, name)
    if not three_patches:
        inner = _inner(outline) if rectangle is None else outline
        return CardReading(name, _measure(picture, inner, name), inner, normal)
    patches = [(_mean(picture, patch), patch) for patch in _thirds(outline)]
    (black, _), (_, middle), (white, _) = sorted(patches, key=lambda one: one[0].mean())
    grey = _measure(picture, middle, name)
    if not 1.4 * black.mean() < grey.mean() < white.mean() / 1.2:
        raise ConfigurationError(
            f"{name}: the card's three parts have levels {black.mean():.0f}, {grey.mean():.0f} and "
            f"{white.mean():.0f}, expected black, gray and white side by side (--three-patches)"
        )
    return CardReading(name, grey, middle, normal, white, black)


def _thirds(card: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """The inner parts of a card's three patches, side by side along its longer edge."""
    if np.linalg.norm(card[1] - card[0]) < np.linalg.norm(card[3] - card[0]):
        card = np.roll(card, 1, axis=0)
    upper, lower = card[1] - card[0], card[2] - card[3]
    return [
        _inner(
            np.array(
                [
                    card[0] + third / 3 * upper,
                    card[0] + (third + 1) / 3 * upper,
                    card[3] + (third + 1) / 3 * lower,
                    card[3] + third / 3 * lower,
                ]
            )
        )
        for third in range(3)
    ]


def _inner(outline: NDArray[np.float64]) -> NDArray[np.float64]:
    middle = outline.mean(axis=0)
    return middle + INNER_SHARE * (outline - middle)


def _corners(rectangle: Rectangle, picture: Picture, name: str) -> NDArray[np.float64]:
    left, top, width, height = rectangle
    rows, columns = picture.shape[:2]
    if (
        min(left, top) < 0
        or min(width, height) < 4
        or left + width > columns
        or top + height > rows
    ):
        raise ConfigurationError(
            f"--card is {left},{top},{width},{height}, expected X,Y,WIDTH,HEIGHT within "
            f"{columns} x {rows} pixels of {name}"
        )
    x, y = (left, left + width - 1), (top, top + height - 1)
    return np.array([(x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1])], np.float64)


def _measure(picture: Picture, outline: NDArray[np.float64], name: str) -> NDArray[np.float64]:
    """Mean levels within the outline. Shape (3,).

    Raises:
        ConfigurationError: it is outside of the picture, cut off or uneven.

    """
    mask = _mask(picture, outline)
    levels = picture[mask].astype(np.float64)
    if len(levels) < 16:
        raise ConfigurationError(f"{name}: the gray card is too small or outside of the picture")
    mean = levels.mean(axis=0)
    if mean.min() < DARKEST or np.percentile(levels, 95, axis=0).max() > BRIGHTEST:
        kind = "dark" if mean.min() < DARKEST else "bright"
        raise ConfigurationError(
            f"{name}: the gray card is too {kind}, levels {_words(mean)} of 255; take it with "
            "another exposure, as the camera has when it drives"
        )
    grey = cast(NDArray[np.uint8], cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY))
    # Averaged over a few pixels, so that noise is no unevenness.
    soft = cv2.blur(grey, (5, 5))[mask].astype(np.float64)
    low, high = np.percentile(soft, [5, 95])
    if high - low > 2 * MOST_UNEVEN * soft.mean() + 4:
        raise ConfigurationError(
            f"{name}: the gray card is unevenly lit, levels from {low:.0f} to {high:.0f}; keep "
            "shadows and glare off it, or measure a part with --card"
        )
    return mean


def _mean(picture: Picture, outline: NDArray[np.float64]) -> NDArray[np.float64]:
    return picture[_mask(picture, outline)].astype(np.float64).mean(axis=0)


def _mask(picture: Picture, outline: NDArray[np.float64]) -> NDArray[np.bool_]:
    """True within the outline. Shape (height, width)."""
    mask = np.zeros(picture.shape[:2], np.uint8)
    cv2.fillPoly(mask, [np.round(outline).astype(np.int32)], 1)
    return mask == 1


def _words(levels: NDArray[np.float64]) -> str:
    return ", ".join(f"{level:.0f}" for level in levels)
