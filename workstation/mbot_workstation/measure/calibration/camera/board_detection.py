"""Finds the corners of a checkerboard or ChArUco board in a picture, to a tenth of a pixel."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from mbot_workstation.measure.targets.specifications import Board, charuco_board

Grey = NDArray[np.uint8]
"""Shape (height, width)."""

WORKING_WIDTH_PX = 1000
"""Smaller pictures are enlarged for the detector: at 320 pixels that halves the corners' error, to
0.07 px, and finds a third more boards (measured on drawn ones)."""

LARGEST_ENLARGEMENT = 4

FEWEST_CHARUCO_CORNERS = 8
"""Of a part of a board; fewer say next to nothing beside the 6 numbers of its pose."""

REFINED_SHARE = 0.1
"""Half a window for refining ChArUco corners, as a share of a square's shorter edge in the picture:
the markers begin at an eighth."""


MOST_BEND = 0.5
"""A board's rows and columns are straight but for the lens: from one square to the next an edge
changes by 0.15 of itself at most in photographs with a distorting lens, and by 0.95 where the
detector took a board's rim for a row of corners (measured on the photographs of
`benchmarks/camera.py`)."""


@dataclass(frozen=True, slots=True)
class FoundBoard:
    """A board in a picture.

    Attributes:
        points_m: its corners on the board, shape (n, 3), z = 0.
        corners_px: the same in the picture, shape (n, 2); the first pixel's centre is (0, 0).
        mirrored: whether the picture shows it mirrored; None where nobody can tell.

    """

    points_m: NDArray[np.float32]
    corners_px: NDArray[np.float32]
    mirrored: bool | None


@dataclass(frozen=True, slots=True)
class Sighting:
    """A board in one picture of a set: the picture's name, its width and height in pixels, and the
    board. This is what a camera is fitted to.
    """

    name: str
    size: tuple[int, int]
    board: FoundBoard


def find_board(picture: Grey, board: Board) -> FoundBoard | None:
    """The board in a grey picture of shape (h, w), or None.

    Raises:
        ValueError: the board's dictionary does not exist, or is too small for it.

    """
    scale = _enlargement(picture)
    large = picture
    if scale > 1:
        large = cast(
            Grey, cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)
        )
    found = (_find_charuco if board.charuco else _find_checkerboard)(large, board)
    if found is None or scale == 1:
        return found
    corners = ((found.corners_px + 0.5) / scale - 0.5).astype(np.float32)
    return FoundBoard(found.points_m, corners, found.mirrored)


def most_likely_checkerboard(pictures: Iterable[Grey]) -> Board | None:
    """The checkerboard whose size is seen in most of the pictures; None if there is none.

    The pictures are grey, shape (h, w) each.

    Where a part of the board is hidden a smaller one is seen, so the largest that is seen in more
    than one picture, and in a seventh of those with any, is taken.
    """
    seen: Counter[tuple[int, int]] = Counter()
    for picture in pictures:
        size = _checkerboard_size(picture)
        if size is not None:
            seen[size] += 1
    enough = max(2, seen.total() / 7)
    for corners in sorted(seen, key=lambda size: size[0] * size[1], reverse=True):
        if seen[corners] >= enough or len(seen) == 1:
            return Board(corners[0] + 1, corners[1] + 1)
    return None


def _checkerboard_size(picture: Grey) -> tuple[int, int] | None:
    """Inner corners, the larger number first, of whatever checkerboard there is."""
    share = min(1.0, WORKING_WIDTH_PX / max(picture.shape))
    small = cv2.resize(picture, None, fx=share, fy=share, interpolation=cv2.INTER_AREA)
    flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_LARGER
    found, _, meta = cv2.findChessboardCornersSBWithMeta(small, (3, 3), flags)
    if not found:
        return None
    rows, columns = meta.shape[:2]
    return (max(rows, columns), min(rows, columns))


def _enlargement(picture: Grey) -> int:
    wanted = round(WORKING_WIDTH_PX / max(picture.shape))
    return int(np.clip(wanted, 1, LARGEST_ENLARGEMENT))


def _find_checkerboard(picture: Grey, board: Board) -> FoundBoard | None:
    # ACCURACY would bring 0.05 instead of 0.07 px at 1014 pixels, for four times the work.
    corners = _checkerboard_corners(picture, board, cv2.CALIB_CB_EXHAUSTIVE)
    if corners is None:
        # Spreading the grey levels moves corners by half as much again: only where it has to be.
        flags = cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_NORMALIZE_IMAGE
        corners = _checkerboard_corners(picture, board, flags)
    if corners is None:
        return None
    mirrored = _is_mirrored(picture, corners, board) if board.tells_mirrored else None
    return FoundBoard(board.corner_points(), corners, mirrored)


def _checkerboard_corners(picture: Grey, board: Board, flags: int) -> NDArray[np.float32] | None:
    """Shape (n, 2)."""
    found, corners = cv2.findChessboardCornersSB(picture, board.inner_corners, flags=flags)
    if not found:
        return None
    columns, rows = board.inner_corners
    seen = np.asarray(corners, np.float32)
    return seen.reshape(-1, 2) if bend(seen.reshape(rows, columns, 2)) <= MOST_BEND else None


def bend(grid: NDArray[np.floating]) -> float:
    """By how much an edge differs from the next one in line, at most, as a share of the shorter.

    Args:
        grid: corners, shape (rows, columns, 2).

    """
    most = 0.0
    for axis in (0, 1):
        edges = np.diff(grid, axis=axis)
        lengths = np.swapaxes(np.linalg.norm(edges, axis=2), 0, axis)
        changes = np.swapaxes(np.linalg.norm(np.diff(edges, axis=axis), axis=2), 0, axis)
        shorter = np.maximum(np.minimum(lengths[1:], lengths[:-1]), 1e-6)
        most = max(most, float((changes / shorter).max(initial=0)))
    return most


def _is_mirrored(picture: Grey, corners: NDArray[np.float32], board: Board) -> bool:
    """Whether the numbering of the corners, as a good picture has it, starts at a white square.

    With an even number of squares both ways, the squares at the board's first and last corner are
    black and those at the two others white; in a mirror it is the other way round.
    """
    columns, rows = board.inner_corners
    grid = corners.reshape(rows, columns, 2)
    right, down = grid[0, 1] - grid[0, 0], grid[1, 0] - grid[0, 0]
    goes_clockwise = right[0] * down[1] - right[1] * down[0] > 0
    # The first square between four corners has the colour of the corner's own square.
    middles = (grid[:-1, :-1] + grid[1:, 1:]) / 2
    levels = picture[
        np.clip(middles[..., 1].round().astype(int), 0, picture.shape[0] - 1),
        np.clip(middles[..., 0].round().astype(int), 0, picture.shape[1] - 1),
    ].astype(float)
    row, column = np.indices(levels.shape)
    like_first = (row + column) % 2 == 0
    first_is_black = levels[like_first].mean() < levels[~like_first].mean()
    return bool(first_is_black != goes_clockwise)


def _find_charuco(picture: Grey, board: Board) -> FoundBoard | None:
    for mirrored in (False, True):
        seen = np.ascontiguousarray(picture[:, ::-1]) if mirrored else picture
        found = _charuco_corners(seen, board)
        if found is not None:
            points, corners = found
            if mirrored:
                corners[:, 0] = picture.shape[1] - 1 - corners[:, 0]
            return FoundBoard(points, corners, mirrored)
    return None


def _charuco_corners(
    picture: Grey, board: Board
) -> tuple[NDArray[np.float32], NDArray[np.float32]] | None:
    corners, numbers, _, _ = cv2.aruco.CharucoDetector(charuco_board(board)).detectBoard(picture)
    if numbers is None or len(numbers) < FEWEST_CHARUCO_CORNERS:
        return None
    points = board.corner_points()[np.asarray(numbers, np.intp).ravel()]
    if np.linalg.matrix_rank(points[:, :2] - points[:, :2].mean(axis=0), tol=1e-6) < 2:
        return None  # all in one line
    seen = np.asarray(corners, np.float32).reshape(-1, 2)
    stop = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 50, 1e-4)
    for corner, edge_px in zip(seen, _edges_px(points, seen, board), strict=True):
        half = max(2, round(REFINED_SHARE * edge_px))
        corner[:] = cv2.cornerSubPix(
            picture, corner.reshape(1, 1, 2).copy(), (half, half), (-1, -1), stop
        ).ravel()
    return points, seen


def _edges_px(
    points_m: NDArray[np.float32], corners_px: NDArray[np.float32], board: Board
) -> list[float]:
    """The shorter edge of a square around each corner, as foreshortened in the picture."""
    plane, _ = cv2.findHomography(points_m[:, :2], corners_px)
    edge = board.square_mm / 1000
    places = points_m[:, None, :2] + np.array([[0, 0], [edge, 0], [0, edge]], np.float32)
    seen = cv2.perspectiveTransform(places.reshape(1, -1, 2), plane).reshape(-1, 3, 2)
    return np.linalg.norm(seen[:, 1:] - seen[:, :1], axis=2).min(axis=1).tolist()
