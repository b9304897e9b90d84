"""Where frames come from: the Pi camera, or anything OpenCV opens.

Each source is a context manager whose `read` blocks for the next frame and never longer than
READ_TIMEOUT_S, so that a dead camera can be closed and opened anew.
"""

import time
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol, Self, cast

import cv2

from mbot_agent.configuration import Camera
from mbot_protocol.errors import UnreachableError
from mbot_protocol.picture import Picture

OPEN_TIMEOUT_S = 3.0
READ_TIMEOUT_S = 1.0

PICAMERA_DEFAULT_SIZE = (320, 240)
"""Five samples a side for each observation pixel; the ISP scales, so it costs the CPU nothing."""

SENSOR_MODE = (2028, 1520)
"""The IMX477's full-view mode, binned 2 x 2; others crop (1332 x 990 sees 38 x 28.7 degrees)."""


class CameraError(UnreachableError):
    """The camera cannot be opened, or delivers no frame."""


class FrameSource(Protocol):
    """One opened camera."""

    def __enter__(self) -> Self:
        """Open it."""
        ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close it."""
        ...

    def read(self) -> tuple[Picture, int]:
        """The next frame, RGB, shape (height, width, 3), and its monotonic capture time in ns.

        Raises:
            CameraError: none came in READ_TIMEOUT_S, or the source has ended.

        """
        ...


def frame_source(camera: Camera) -> FrameSource:
    """The source a configuration names; not opened yet."""
    return PiCameraSource(camera) if camera.source == "picamera2" else OpenCvSource(camera)


def is_real_camera(camera: Camera) -> bool:
    """Whether frames come from a sensor on this machine, whose noise makes each one different."""
    return camera.source == "picamera2" or _device_index(camera.source) is not None


def _device_index(source: str) -> int | None:
    """The number of a camera given as "0" or "/dev/video0"; None for files and URLs."""
    digits = source.removeprefix("/dev/video")
    return int(digits) if digits.isascii() and digits.isdigit() else None


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

    def read(self) -> tuple[Picture, int]:
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
        return cast(Picture, cv2.cvtColor(frame, cv2.COLOR_BGR2RGB)), captured_ns


class PiCameraSource:
    """The Raspberry Pi camera by picamera2, scaled on the ISP.

    picamera2 names its formats backwards: "BGR888" arrives as RGB in memory.
    """

    def __init__(self, camera: Camera) -> None:
        self._camera = camera
        self._picamera: Any = None

    def __enter__(self) -> Self:
        try:
            # From Raspberry Pi OS's apt only; heavy, so imported where used.
            import picamera2  # pyright: ignore[reportMissingImports]
        except ImportError as error:
            raise CameraError(
                f"picamera2 cannot be imported ({error}): apt install python3-picamera2, and use "
                "a virtual environment with --system-site-packages (deploy/install.sh makes one)"
            ) from None
        library = cast(Any, picamera2)
        if not library.Picamera2.global_camera_info():
            raise CameraError(
                "libcamera finds no camera: check the cable and `rpicam-hello --list-cameras`"
            )
        width_px, height_px = PICAMERA_DEFAULT_SIZE
        if self._camera.width_px is not None and self._camera.height_px is not None:
            width_px, height_px = self._camera.width_px, self._camera.height_px
        try:
            picamera = library.Picamera2()
            picamera.configure(
                picamera.create_video_configuration(
                    main={"size": (width_px, height_px), "format": "BGR888"},
                    sensor={"output_size": SENSOR_MODE, "bit_depth": 12},
                    controls={"FrameRate": self._camera.frame_rate_hz},
                    buffer_count=4,
                    queue=False,
                )
            )
            picamera.start()
        except Exception as error:
            raise CameraError(
                f"the Pi camera does not start: {error}; is another program using it?"
            ) from None
        self._picamera = picamera
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._picamera is not None:
            self._picamera.close()
            self._picamera = None

    def read(self) -> tuple[Picture, int]:
        """See FrameSource. The capture time is the sensor's own."""
        try:
            request = self._picamera.capture_request(wait=READ_TIMEOUT_S)
        except Exception as error:
            raise CameraError(
                f"the Pi camera delivers no frames ({type(error).__name__} {error})"
            ) from None
        try:
            frame = cast(Picture, request.make_array("main"))
            captured_boottime_ns = int(request.get_metadata()["SensorTimestamp"])
        finally:
            request.release()
        return frame, _boottime_to_monotonic(captured_boottime_ns)


def _boottime_to_monotonic(boottime_ns: int) -> int:
    """libcamera stamps frames on CLOCK_BOOTTIME, which differs by the time spent suspended."""
    suspended_ns = time.clock_gettime_ns(time.CLOCK_BOOTTIME) - time.monotonic_ns()
    return min(boottime_ns - suspended_ns, time.monotonic_ns())
