"""The printed frame around a gray card: where the card is, and how it is turned."""

from dataclasses import dataclass
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from mbot_protocol.drive.camera_model import CameraModel
from mbot_protocol.drive.picture import Picture
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
