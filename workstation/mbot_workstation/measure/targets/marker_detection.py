"""Finds printed ArUco markers in a picture, to a few hundredths of a pixel.

Corners by themselves are blurred away and drawn inwards by a threshold; a whole edge from black to
white is not, so corners are where edges meet. Measured on drawn markers of 27 pixels: sizes 0.0 %
off instead of 1.4, and 0.35 instead of 2.8 where the picture is blurred by a pixel.
"""

from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from mbot_protocol.drive.picture import Picture
from mbot_workstation.measure.targets.specifications import MARKER_DICTIONARY, dictionary

Array = NDArray[np.float64]
Grey = NDArray[np.uint8]
"""Shape (height, width)."""

PROFILES = 24
"""Along each edge, across it."""

ENDS_LEFT_OUT = 0.12
"""Of an edge at either end, where the other edges' blur reaches."""

REACH_CELLS = 0.75
"""Of a profile to either side, in cells: black inside and white outside are a cell wide."""

CELLS = 6
"""Of a marker's edge, its border included."""

SAMPLES = 41

FEWEST_GOOD = 0.5
"""Share of profiles that must show an edge; less, and the corners stay as they are."""

LEAST_CONTRAST = 25.0

OFF_LINE_PX = 0.5


def refine_corners(picture: Grey, corners_px: Array) -> Array:
    """Corners where straight lines through the edges meet. Shapes (4, 2), clockwise as before.

    Where the edges can't be seen well, or the result is far off, the corners come back unchanged.
    """
    lines = [_edge_line(picture, corners_px[side], corners_px[(side + 1) % 4]) for side in range(4)]
    refined = corners_px.copy()
    for corner in range(4):
        before, after = lines[corner - 1], lines[corner]
        if before is None or after is None:
            return corners_px
        meeting = _meeting(before, after)
        if meeting is None:
            return corners_px
        refined[corner] = meeting
    cell_px = float(np.linalg.norm(corners_px[1] - corners_px[0])) / CELLS
    moved_px = np.linalg.norm(refined - corners_px, axis=1).max()
    return refined if moved_px < max(1.5, 0.5 * cell_px) else corners_px


def _edge_line(picture: Grey, first: Array, second: Array) -> tuple[Array, Array] | None:
    """A point on the edge between two corners and its direction; None if it is not clear."""
    along = second - first
    length_px = float(np.linalg.norm(along))
    if length_px < CELLS:
        return None
    direction = along / length_px
    outward = np.array([direction[1], -direction[0]])  # clockwise, y down: the outside is left
    reach_px = max(1.5, REACH_CELLS * length_px / CELLS)
    shares = np.linspace(ENDS_LEFT_OUT, 1 - ENDS_LEFT_OUT, PROFILES)
    offsets_px = np.linspace(-reach_px, reach_px, SAMPLES)
    feet = first + shares[:, None] * along
    places = (feet[:, None] + offsets_px[None, :, None] * outward).astype(np.float32)
    profiles = cv2.remap(
        picture, places[..., 0], places[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    ).astype(np.float64)
    at_px, good = _crossings(profiles, offsets_px)
    if np.count_nonzero(good) < FEWEST_GOOD * PROFILES:
        return None
    return _robust_line(feet[good] + at_px[good, None] * outward)


def _crossings(profiles: Array, offsets_px: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Where each profile rises from black to white, by its area, and whether it clearly does.

    Black up to the edge and white after it, the mean between the two levels says where the edge
    is, however it is blurred.
    """
    third = len(offsets_px) // 5
    black, white = profiles[:, :third].mean(axis=1), profiles[:, -third:].mean(axis=1)
    contrast = white - black
    good = contrast > LEAST_CONTRAST
    share = (profiles.mean(axis=1) - black) / np.where(good, contrast, 1.0)
    span_px = offsets_px[-1] - offsets_px[0]
    at_px = offsets_px[-1] - share * span_px
    return at_px, good & (np.abs(at_px) < 0.8 * offsets_px[-1])


def _robust_line(points: Array) -> tuple[Array, Array] | None:
    place, direction = _line(points)
    for _ in range(2):
        normal = np.array([-direction[1], direction[0]])
        near = np.abs((points - place) @ normal) < OFF_LINE_PX
        if np.count_nonzero(near) < FEWEST_GOOD * PROFILES:
            return None
        place, direction = _line(points[near])
    return place, direction


def _line(points: Array) -> tuple[Array, Array]:
    fitted = cv2.fitLine(points.astype(np.float32), cv2.DIST_HUBER, 0, 0, 0)
    vx, vy, x, y = np.asarray(fitted, dtype=np.float64).ravel()
    return np.array([x, y]), np.array([vx, vy])


def _meeting(first: tuple[Array, Array], second: tuple[Array, Array]) -> Array | None:
    matrix = np.stack([first[1], -second[1]], axis=1)
    if abs(np.linalg.det(matrix)) < 0.2:
        return None
    along = np.linalg.solve(matrix, second[0] - first[0])
    return first[0] + along[0] * first[1]


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
