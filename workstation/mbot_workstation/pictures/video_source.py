"""Frames of a camera on this machine, of a stream or of a video file."""

import os
from pathlib import Path
from typing import Self, cast

import cv2

from mbot_protocol.drive.picture import Picture
from mbot_protocol.drive.video_capture import open_capture
from mbot_protocol.errors import UnreachableError

OPEN_TIMEOUT_S, READ_TIMEOUT_S = 5.0, 3.0
"""A stream over Wi-Fi may pause for a second; one that is gone must not hang for half a minute."""


class VideoSource:
    """Opened by `with`.

    Attributes:
        source: a device ("0", "/dev/video0"), a URL (the robot's own stream), or a file.

    """

    def __init__(self, source: str) -> None:
        self.source = source
        self._capture: cv2.VideoCapture | None = None

    def __enter__(self) -> Self:
        """Open it.

        Raises:
            UnreachableError: there is no such camera, stream or file.

        """
        # What went wrong is said once, by us: OpenCV and FFmpeg would each write lines of theirs.
        os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
        cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
        capture = open_capture(self.source, OPEN_TIMEOUT_S, READ_TIMEOUT_S)
        if not capture.isOpened():
            capture.release()
            raise UnreachableError(
                f"can't open the camera {self.source!r}; expected a device such as 0 or "
                "/dev/video0, a URL such as http://127.0.0.1:8090/stream.mjpg, or a video file"
            )
        self._capture = capture
        return self

    def __exit__(self, *_: object) -> None:
        if self._capture is not None:
            self._capture.release()
            self._capture = None

    @property
    def position_s(self) -> float:
        """Where the next frame of a file is in it."""
        return self._capture.get(cv2.CAP_PROP_POS_MSEC) / 1000 if self._capture else 0.0

    def read(self) -> Picture | None:
        """The next frame, shape (height, width, 3), RGB; None at the end of a file.

        Raises:
            UnreachableError: the camera has stopped delivering.

        """
        if self._capture is None:
            raise RuntimeError("the camera is not open")
        delivered, frame = self._capture.read()
        if delivered:
            return cast(Picture, cv2.cvtColor(frame, cv2.COLOR_BGR2RGB))
        if Path(self.source).is_file():
            return None
        raise UnreachableError(f"the camera {self.source!r} has stopped delivering pictures")
