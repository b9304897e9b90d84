"""Takes pictures of a board from a stream by itself: when the board is still, in a new pose."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import cv2
import numpy as np
from numpy.typing import NDArray

from mbot_workstation.measure.calibration.camera.board_detection import FoundBoard, Grey, find_board
from mbot_workstation.measure.calibration.camera.camera_quality import areas_without
from mbot_workstation.measure.targets.specifications import Board

STILL_SHARE = 0.004
"""Of the picture's width: a corner that moves by less from frame to frame is still. 1.3 of 320
pixels; a hand that holds a board moves it by less."""

STILL_S = 0.4
"""So long must it be still: longer than an exposure and a rolling read-out by far."""

NEW_POSE_SHARE = 0.08
"""Of the picture's width: in a new pose, a corner of the board is at least this far from where it
was in any picture taken."""


class Verdict(Enum):
    """What a frame was good for."""

    NO_BOARD = "no board in view"
    MIRRORED = "the board is mirrored: switch the camera's mirror or flip off"
    MOVING = "hold it still"
    SAME_POSE = "move or tilt the board"
    TAKEN = "taken"


@dataclass(frozen=True, slots=True)
class _Seen:
    found: FoundBoard
    outline_px: NDArray[np.float64]


class BoardCollector:
    """Judges frame after frame.

    Attributes:
        count: pictures taken.

    """

    def __init__(self, boards: Sequence[Board]) -> None:
        self.count = 0
        self._boards = boards
        self._size = (1, 1)
        self._taken: list[NDArray[np.float64]] = []
        self._corners: list[NDArray[np.float32]] = []
        self._last: _Seen | None = None
        self._still_since_s = 0.0

    def empty_areas(self) -> tuple[str, ...]:
        """Names of areas of the view without a corner so far."""
        corners = np.concatenate([np.zeros((0, 2), np.float32), *self._corners])
        return areas_without(corners, *self._size)

    def offer(self, picture: Grey, now_s: float) -> Verdict:
        """Judge a frame.

        Args:
            picture: the frame, grey, shape (h, w).
            now_s: when it was taken, on a clock that only rises.

        """
        self._size = picture.shape[1], picture.shape[0]
        last, self._last = self._last, self._see(picture)
        seen = self._last
        if seen is None:
            return Verdict.NO_BOARD
        if seen.found.mirrored:
            return Verdict.MIRRORED
        width = picture.shape[1]
        if last is None or _apart(seen.outline_px, last.outline_px) > STILL_SHARE * width:
            self._still_since_s = now_s
            return Verdict.MOVING
        if now_s - self._still_since_s < STILL_S:
            return Verdict.MOVING
        far = NEW_POSE_SHARE * width
        if any(_apart(seen.outline_px, outline) < far for outline in self._taken):
            return Verdict.SAME_POSE
        self._taken.append(seen.outline_px)
        self._corners.append(seen.found.corners_px)
        self.count += 1
        return Verdict.TAKEN

    def _see(self, picture: Grey) -> _Seen | None:
        for board in self._boards:
            found = find_board(picture, board)
            if found is not None:
                self._boards = [board]  # nobody changes boards in between
                return _Seen(found, _outline(found, board))
        return None


def _outline(found: FoundBoard, board: Board) -> NDArray[np.float64]:
    """The board's own four corners in the picture, hidden or not. Shape (4, 2)."""
    plane, _ = cv2.findHomography(found.points_m[:, :2], found.corners_px)
    width, height = (n * board.square_mm / 1000 for n in (board.columns, board.rows))
    corners = np.array([[0, 0], [width, 0], [width, height], [0, height]])
    return np.asarray(cv2.perspectiveTransform(corners[None], plane))[0]


def _apart(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """How far the corner that moved most has moved, in pixels.

    A checkerboard may be numbered from either end, so the smaller one of both counts.
    """
    return min(
        float(np.linalg.norm(one - turned, axis=1).max())
        for turned in (other, np.roll(other, 2, axis=0))
    )
