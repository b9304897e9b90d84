"""Where frames come from: the Pi camera, JPEGs over HTTP, or anything else OpenCV opens."""

import logging
import time
from pathlib import Path
from types import TracebackType
from typing import Self, cast

import cv2

from mbot_agent.camera.pi_camera_source import PiCameraSource
from mbot_agent.camera.source_contract import (
    OPEN_TIMEOUT_S,
    READ_TIMEOUT_S,
    CameraError,
    FrameSource,
    Shot,
)
from mbot_agent.configuration import Camera
from mbot_protocol.picture import Picture

log = logging.getLogger(__name__)


def frame_source(camera: Camera) -> FrameSource:
    """The source a configuration names; not opened yet."""
    if camera.source == "picamera2":
        return PiCameraSource(camera)
    return HttpSource(camera) if camera.source.startswith("http://") else OpenCvSource(camera)


def is_real_camera(camera: Camera) -> bool:
    """Whether frames come from a sensor on this machine, whose noise makes each one different."""
    return camera.source == "picamera2" or _device_index(camera.source) is not None


def _device_index(source: str) -> int | None:
    """The number of a camera given as "0" or "/dev/video0"; None for files and URLs."""
    digits = source.removeprefix("/dev/video")
    return int(digits) if digits.isascii() and digits.isdigit() else None


class HttpSource:
    """Whatever is at an http:// address: a stream of JPEGs, or else what OpenCV makes of it."""

    def __init__(self, camera: Camera) -> None:
        self._camera = camera
        self._source: FrameSource | None = None

    def __enter__(self) -> Self:
        # Python's HTTP and TLS come with it, 2 MB that a robot's own camera does not need.
        from mbot_agent.camera.mjpeg_source import MjpegSource, NotMjpegError

        try:
            self._source = MjpegSource(self._camera.source).__enter__()
        except NotMjpegError as error:
            log.info("%s %s: trying OpenCV", self._camera.source, error)
            self._source = OpenCvSource(self._camera).__enter__()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._source is not None:
            self._source.__exit__(kind, error, trace)
            self._source = None

    def read(self) -> Shot:
        """See FrameSource."""
        if self._source is None:
            raise CameraError("the camera is not open")
        return self._source.read()


class OpenCvSource:
    """A camera device, a video file or a stream, by OpenCV.

    A frame's capture time is when it was read: for a device or stream that is right after it
    came. A file is played at its own rate, and its end is the camera's end.
    """

    def __init__(self, camera: Camera) -> None:
        self._camera = camera
        self._capture: cv2.VideoCapture | None = None
        self._file_interval_s = 0.0
        self._file_next_s = 0.0

    def __enter__(self) -> Self:
        source = self._camera.source
        index = _device_index(source)
        if index is None:
            timeouts = [
                *(cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, int(OPEN_TIMEOUT_S * 1000)),
                *(cv2.CAP_PROP_READ_TIMEOUT_MSEC, int(READ_TIMEOUT_S * 1000)),
            ]
            capture = cv2.VideoCapture(source, cv2.CAP_FFMPEG, timeouts)
        else:
            capture = cv2.VideoCapture(index)
            capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
            if self._camera.width_px is not None and self._camera.height_px is not None:
                capture.set(cv2.CAP_PROP_FRAME_WIDTH, self._camera.width_px)
                capture.set(cv2.CAP_PROP_FRAME_HEIGHT, self._camera.height_px)
            capture.set(cv2.CAP_PROP_FPS, self._camera.frame_rate_hz)
        if not capture.isOpened():
            capture.release()
            raise CameraError(
                f"cannot open the camera {source!r}: does it exist, is it running, may this user "
                "read it (group video)? (camera.source)"
            )
        if Path(source).is_file():
            rate_hz = capture.get(cv2.CAP_PROP_FPS) or self._camera.frame_rate_hz
            self._file_interval_s = 1.0 / rate_hz
            self._file_next_s = time.monotonic()
        self._capture = capture
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._capture is not None:
            self._capture.release()
            self._capture = None

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
            raise CameraError(f"the camera {self._camera.source!r} has stopped delivering frames")
        picture = cast(Picture, cv2.cvtColor(frame, cv2.COLOR_BGR2RGB))
        return Shot.decoded(picture, captured_ns)
