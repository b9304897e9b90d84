"""Where a gray card is in a photograph: in its printed frame, or plain."""

from dataclasses import dataclass
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from mbot_protocol.drive.camera_model import CameraModel
from mbot_protocol.drive.picture import Picture
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.measure.targets.layouts import card_marker_places, card_place
from mbot_workstation.measure.targets.marker_detection import MarkerDetector
from mbot_workstation.measure.targets.sheet import PAPERS
from mbot_workstation.measure.targets.specifications import (
    CARD_MARKER_EDGE_MM,
    CARD_MARKER_IDS,
)

Values = NDArray[np.float64]

FEWEST_MARKERS = 3
"""Of the frame's four: one may be hidden by a hand."""


@dataclass(frozen=True, slots=True)
class FramedCard:
    """A card in its frame.

    Attributes:
        outline_px: corners of the card in the picture, shape (4, 2), clockwise.
        normal: unit vector out of the card in OpenCV's camera frame, shape (3,): x right, y down,
            z away from the camera.

    """

    outline_px: Values
    normal: Values


@dataclass(frozen=True, slots=True)
class _SheetPose:
    """A sheet of one size that may be the frame's; error in pixels, pose in millimetres."""

    error_px: float
    width_mm: float
    height_mm: float
    turn: Values
    place: Values


def find_framed_card(
    picture: Picture, camera: CameraModel, card_mm: tuple[float, float]
) -> FramedCard | None:
    """The card in the frame; None if the frame is not in view.

    Args:
        picture: RGB.
        camera: at the picture's size.
        card_mm: width and height of the card.

    """
    grey = cast(NDArray[np.uint8], cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY))
    found = MarkerDetector().find(grey)
    seen = {number: found[number] for number in CARD_MARKER_IDS if number in found}
    if len(seen) < FEWEST_MARKERS:
        return None
    # Sheets differ in where the markers are: the one that fits best is the one that was printed.
    fits = [_pose(seen, camera, paper.height_mm, paper.width_mm) for paper in PAPERS.values()]
    sheet = min(fits, key=lambda fit: fit.error_px)
    if not np.isfinite(sheet.error_px):
        return None
    left, top, width, height = card_place(sheet.width_mm, sheet.height_mm)
    middle = np.array([left + width / 2, top + height / 2])
    corners = middle + np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * np.array(card_mm) / 2
    outline, _ = cv2.projectPoints(
        np.column_stack([corners, np.zeros(4)]),
        sheet.turn,
        sheet.place,
        camera.matrix,
        np.array(camera.distortion),
    )
    # The page's z points into the paper, as x is to the right and y down.
    normal = -np.asarray(cv2.Rodrigues(sheet.turn)[0], np.float64)[:, 2]
    return FramedCard(np.asarray(outline, np.float64).reshape(4, 2), normal)


def _pose(
    seen: dict[int, Values], camera: CameraModel, width_mm: float, height_mm: float
) -> _SheetPose:
    edge = CARD_MARKER_EDGE_MM
    square = np.array([[0, 0], [edge, 0], [edge, edge], [0, edge]])
    corners = card_marker_places(width_mm, height_mm)
    flat = np.concatenate([np.array(corners[CARD_MARKER_IDS.index(n)]) + square for n in seen])
    points = np.column_stack([flat, np.zeros(len(flat))])
    pixels = np.concatenate(list(seen.values()))
    matrix, distortion = camera.matrix, np.array(camera.distortion)
    found, turn, place = cv2.solvePnP(points, pixels, matrix, distortion, flags=cv2.SOLVEPNP_IPPE)
    if not found:
        return _SheetPose(np.inf, width_mm, height_mm, np.zeros(3), np.zeros(3))
    turn, place = cv2.solvePnPRefineLM(points, pixels, matrix, distortion, turn, place)
    again, _ = cv2.projectPoints(points, turn, place, matrix, distortion)
    apart = np.asarray(again, np.float64).reshape(-1, 2) - pixels
    return _SheetPose(
        float(np.sqrt((apart**2).sum(axis=1).mean())),
        width_mm,
        height_mm,
        np.asarray(turn, np.float64),
        np.asarray(place, np.float64),
    )


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
