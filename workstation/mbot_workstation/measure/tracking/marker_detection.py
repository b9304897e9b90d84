"""Finds printed ArUco markers in a picture, to a tenth of a pixel."""

from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from mbot_protocol.drive.picture import Picture
from mbot_workstation.measure.targets.specifications import MARKER_DICTIONARY, dictionary
from mbot_workstation.measure.tracking.marker_edges import refine_corners
from mbot_workstation.sim.track import Array

Grey = NDArray[np.uint8]
"""Shape (height, width)."""


class MarkerDetector:
    """Of the dictionary that all printed markers come from."""

    def __init__(self) -> None:
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX  # a first step
        self._detector = cv2.aruco.ArucoDetector(dictionary(MARKER_DICTIONARY), parameters)

    def find(self, picture: Grey) -> dict[int, Array]:
        """Every marker by its number: its corners clockwise from its upper left one. Shape (4, 2).

        A marker seen twice is in none of its places: nobody knows which is meant.
        """
        corners, numbers, _ = self._detector.detectMarkers(picture)
        found: dict[int, Array] = {}
        seen: list[int] = [] if numbers is None else [int(n) for n in np.asarray(numbers).ravel()]
        for number, quad in zip(seen, corners, strict=False):
            if seen.count(number) == 1:
                found[number] = refine_corners(picture, np.asarray(quad, np.float64).reshape(4, 2))
        return found


def to_grey(picture: Picture) -> Grey:
    """An RGB picture, shape (h, w, 3), in grey, shape (h, w)."""
    return cast(Grey, cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY))
