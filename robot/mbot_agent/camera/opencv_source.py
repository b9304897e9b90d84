"""A camera device, a video file, or what FFmpeg opens, by OpenCV."""

import os
import time
from pathlib import Path
from typing import Self, cast

import cv2

from mbot_agent.camera.source_contract import OPEN_TIMEOUT_S, READ_TIMEOUT_S, CameraError, Shot
from mbot_agent.configuration import CameraSettings, shown_source
from mbot_protocol.drive.picture import Picture
from mbot_protocol.drive.video_capture import device_index, open_capture

FFMPEG = "ffmpeg:"
"""In front of an address that FFmpeg is to open: rtsp://, https://, a film over http://."""

os.environ["OPENCV_FFMPEG_CAPTURE_OPTIONS"] = "max_redirects;0"
"""Who answers at the address must not send us to another one, on this computer for instance. FFmpeg
5.1, in Bookworm's OpenCV, does not know this option, and by RTSP every FFmpeg goes where it is sent
(both measured)."""


class OpenCvSource:
    """A camera device, a video file or a stream, by OpenCV.

    A frame's capture time is when it was read: for a device or stream that is right after it
    came. A file is played at its own rate, and its end is the camera's end.
    """

    def __init__(self, camera: CameraSettings) -> None:
        self._camera = camera
        self._capture: cv2.VideoCapture | None = None
        self._file_interval_s = 0.0
        self._file_next_s = 0.0

    def __enter__(self) -> Self:
        source = self._camera.source.removeprefix(FFMPEG)
        capture = open_capture(source, OPEN_TIMEOUT_S, READ_TIMEOUT_S)
        if device_index(source) is not None:
            if self._camera.width_px is not None and self._camera.height_px is not None:
                capture.set(cv2.CAP_PROP_FRAME_WIDTH, self._camera.width_px)
                capture.set(cv2.CAP_PROP_FRAME_HEIGHT, self._camera.height_px)
            capture.set(cv2.CAP_PROP_FPS, self._camera.frame_rate_hz)
        if not capture.isOpened():
            capture.release()
            raise CameraError(
                f"cannot open the camera {shown_source(source)!r}: does it exist, is it running, "
                "may this user read it (group video)? (camera.source)"
            )
        if Path(source).is_file():
            rate_hz = capture.get(cv2.CAP_PROP_FPS) or self._camera.frame_rate_hz
            self._file_interval_s = 1.0 / rate_hz
            self._file_next_s = time.monotonic()
        self._capture = capture
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        if self._capture is not None:
            self._capture.release()
            self._capture = None

    def hold_light(self, held: bool) -> bool:
        """See FrameSource: nobody can tell this one."""
        return False

    def read(self) -> Shot:
        """See FrameSource."""
        if self._capture is None:
            raise CameraError("the camera is not open")
        if self._file_interval_s:
            self._file_next_s += self._file_interval_s
            time.sleep(max(0.0, self._file_next_s - time.monotonic()))
        delivered, frame = self._capture.read()
        captured_ns = time.monotonic_ns()
        if not delivered:
            raise CameraError(
                f"the camera {shown_source(self._camera.source)!r} has stopped delivering frames"
            )
        picture = cast(Picture, cv2.cvtColor(frame, cv2.COLOR_BGR2RGB))
        return Shot.decoded(picture, captured_ns)
