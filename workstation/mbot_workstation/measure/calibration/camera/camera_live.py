"""Collects pictures of a board from a running camera into files."""

import threading
import time
from collections.abc import Callable, Sequence
from datetime import datetime
from pathlib import Path
from typing import Self, cast

import cv2

from mbot_protocol.drive.picture import Picture
from mbot_protocol.errors import MbotError, UnreachableError
from mbot_workstation.measure.calibration.camera.board_collector import BoardCollector, Verdict
from mbot_workstation.measure.calibration.camera.board_detection import Grey
from mbot_workstation.measure.targets.specifications import Board
from mbot_workstation.pictures.picture_file import write_picture
from mbot_workstation.pictures.video_source import VideoSource

ENOUGH_ANYWAY = 1.6
"""Times the number wanted: so many end it even if an area of the view stays empty."""

FIRST_FRAME_TIMEOUT_S = 10.0

Told = Callable[[Verdict, int, tuple[str, ...]], None]
"""Verdict on a frame, pictures so far, areas of the view still empty."""


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
                if verdict is Verdict.TAKEN:
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
