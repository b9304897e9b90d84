"""Takes pictures of a board from a running camera: when the board is still, in a new pose."""

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime
from enum import Enum
from pathlib import Path
from typing import Self, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from mbot_protocol.drive.picture import Picture
from mbot_protocol.errors import MbotError, UnreachableError
from mbot_workstation.measure.calibration.camera.board_detection import FoundBoard, Grey, find_board
from mbot_workstation.measure.calibration.camera.camera_quality import areas_without
from mbot_workstation.measure.targets.specifications import Board
from mbot_workstation.pictures.picture_file import write_picture
from mbot_workstation.pictures.video_source import VideoSource

STILL_SHARE = 0.004
"""Of the picture's width: a corner that moves by less from frame to frame is still. 1.3 of 320
pixels; a hand that holds a board moves it by less."""

STILL_S = 0.4
"""So long must it be still: longer than an exposure and a rolling read-out by far."""

NEW_POSE_SHARE = 0.08
"""Of the picture's width: in a new pose, a corner of the board is at least this far from where it
was in any picture taken."""


class FrameVerdict(Enum):
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

    def offer(self, picture: Grey, now_s: float) -> FrameVerdict:
        """Judge a frame.

        Args:
            picture: the frame, grey, shape (h, w).
            now_s: when it was taken, on a clock that only rises.

        """
        self._size = picture.shape[1], picture.shape[0]
        last, self._last = self._last, self._see(picture)
        seen = self._last
        if seen is None:
            return FrameVerdict.NO_BOARD
        if seen.found.mirrored:
            return FrameVerdict.MIRRORED
        width = picture.shape[1]
        if last is None or _apart(seen.outline_px, last.outline_px) > STILL_SHARE * width:
            self._still_since_s = now_s
            return FrameVerdict.MOVING
        if now_s - self._still_since_s < STILL_S:
            return FrameVerdict.MOVING
        far = NEW_POSE_SHARE * width
        if any(_apart(seen.outline_px, outline) < far for outline in self._taken):
            return FrameVerdict.SAME_POSE
        self._taken.append(seen.outline_px)
        self._corners.append(seen.found.corners_px)
        self.count += 1
        return FrameVerdict.TAKEN

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


ENOUGH_ANYWAY = 1.6
"""Times the number wanted: so many end it even if an area of the view stays empty."""

FIRST_FRAME_TIMEOUT_S = 10.0

Told = Callable[[FrameVerdict, int, tuple[str, ...]], None]
"""FrameVerdict on a frame, pictures so far, areas of the view still empty."""


def collect(
    source: str, boards: Sequence[Board], folder: Path, wanted: int, told: Told
) -> list[Path]:
    """Take pictures until there are enough all over the view, or Ctrl-C, or the end of a file.

    Args:
        source: see `VideoSource`.
        boards: to look for.
        folder: for the pictures; made if need be.
        wanted: how many.
        told: called after every frame.

    Returns:
        The pictures.

    Raises:
        UnreachableError: the camera can't be opened, or stops before any picture was taken.
        ConfigurationError: the pictures can't be written.

    """
    collector = BoardCollector(boards)
    taken: list[Path] = []
    stamp = datetime.now().astimezone().strftime("%Y%m%d-%H%M%S")
    try:
        with _NewestFrame(source) as frames:
            while (frame := frames.next()) is not None:
                picture, at_s = frame
                grey = cast(Grey, cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY))
                verdict = collector.offer(grey, at_s)
                if verdict is FrameVerdict.TAKEN:
                    path = folder / f"live-{stamp}-{len(taken) + 1:03d}.png"
                    taken.append(write_picture(path, picture))
                empty = collector.empty_areas()
                told(verdict, len(taken), empty)
                if len(taken) >= wanted and (not empty or len(taken) >= ENOUGH_ANYWAY * wanted):
                    break
    except KeyboardInterrupt:
        pass  # a person has had enough pictures
    except UnreachableError:
        if not taken:
            raise  # otherwise the pictures so far are what there is
    return taken


class _NewestFrame:
    """Reads a camera in a thread of its own, as frames queue up while the last one is looked at.

    A file is read frame by frame instead, on its own clock.
    """

    def __init__(self, source: str) -> None:
        self._video = VideoSource(source)
        self._is_file = Path(source).is_file()
        self._condition = threading.Condition()
        self._frame: tuple[Picture, float] | None = None
        self._error: MbotError | None = None
        self._closing = False
        self._thread = threading.Thread(target=self._run, name="newest frame", daemon=True)

    def __enter__(self) -> Self:
        self._video.__enter__()
        if not self._is_file:
            self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closing = True
        if not self._is_file:
            self._thread.join()
        self._video.__exit__()

    def next(self) -> tuple[Picture, float] | None:
        """A frame not seen before and its time in seconds; None at the end of a file.

        Raises:
            UnreachableError: the camera has stopped delivering.

        """
        if self._is_file:
            at_s = self._video.position_s
            picture = self._video.read()
            return None if picture is None else (picture, at_s)
        with self._condition:
            self._condition.wait_for(
                lambda: self._frame is not None or self._error is not None, FIRST_FRAME_TIMEOUT_S
            )
            if self._error is not None:
                raise self._error
            frame, self._frame = self._frame, None
        return frame

    def _run(self) -> None:
        while not self._closing:
            try:
                picture = self._video.read()
            except MbotError as error:
                with self._condition:
                    self._error = error
                    self._condition.notify_all()
                return
            if picture is not None:
                with self._condition:
                    self._frame = picture, time.monotonic()
                    self._condition.notify_all()
