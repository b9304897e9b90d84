"""The Raspberry Pi camera."""

import logging
import time
from collections.abc import Generator
from contextlib import contextmanager, suppress
from typing import Any, Self, cast

from mbot_agent.camera.source_contract import READ_TIMEOUT_S, CameraError, Shot
from mbot_agent.configuration import CameraSettings
from mbot_protocol.drive.picture import Picture

log = logging.getLogger(__name__)

PIXEL_FORMAT = "BGR888"
"""picamera2 names its formats backwards: this one lies as R, G, B in memory."""

PICAMERA_DEFAULT_SIZE = (320, 240)
"""Five samples a side for each observation pixel; the ISP scales, so it costs the CPU nothing."""

SENSOR_MODE = (2028, 1520)
"""The IMX477's full-view mode, binned 2 x 2; others crop (1332 x 990 sees 38 x 28.7 degrees).

Another sensor gets the mode that picamera2 (0.3.38) finds nearest, which sees all as well: IMX219
3280 x 2464, IMX708 2304 x 1296, OV5647 2592 x 1944."""


class PiCameraSource:
    """The Raspberry Pi camera by picamera2, scaled on the ISP."""

    def __init__(self, camera: CameraSettings) -> None:
        self._camera = camera
        self._picamera: Any = None

    def __enter__(self) -> Self:
        library = _picamera2()
        with _explained("libcamera cannot be asked for its cameras"):
            cameras = library.Picamera2.global_camera_info()
        if not cameras:
            raise CameraError(
                "libcamera finds no camera: check the cable and `rpicam-hello --list-cameras`"
            )
        try:
            with _explained("the Pi camera does not start; is another program using it?"):
                self._picamera = library.Picamera2()
                self._begin(self._picamera)
        except CameraError:
            with suppress(CameraError):
                self.__exit__(None, None, None)  # or no other attempt would get at the camera
            raise
        return self

    def _begin(self, picamera: Any) -> None:
        width_px, height_px = PICAMERA_DEFAULT_SIZE
        if self._camera.width_px is not None and self._camera.height_px is not None:
            width_px, height_px = self._camera.width_px, self._camera.height_px
        picamera.configure(
            picamera.create_video_configuration(
                main={"size": (width_px, height_px), "format": PIXEL_FORMAT},
                sensor={"output_size": SENSOR_MODE, "bit_depth": 12},
                controls={"FrameRate": self._camera.frame_rate_hz},
                buffer_count=4,
                queue=False,
            )
        )
        # A camera that cannot do it gets another format, and no word of it.
        given = picamera.camera_configuration()["main"]["format"]
        if given != PIXEL_FORMAT:
            raise CameraError(
                f"this camera gives {given} by picamera2, expected {PIXEL_FORMAT}: for a USB "
                'camera, camera.source = "/dev/video0"'
            )
        picamera.start()

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        picamera, self._picamera = self._picamera, None
        if picamera is not None:
            with _explained("the Pi camera cannot be closed"):
                picamera.close()

    def read(self) -> Shot:
        """See FrameSource. The capture time is the sensor's own."""
        with _explained("the Pi camera delivers no frames"):
            request = self._picamera.capture_request(wait=READ_TIMEOUT_S)
            try:
                frame = cast(Picture, request.make_array("main"))
                captured_boottime_ns = int(request.get_metadata()["SensorTimestamp"])
            finally:
                request.release()
        return Shot.decoded(frame, _boottime_to_monotonic(captured_boottime_ns))

    def hold_light(self, held: bool) -> bool:
        """See FrameSource. libcamera keeps the last values where no others are given."""
        try:
            self._picamera.set_controls({"AeEnable": not held, "AwbEnable": not held})
        except Exception as error:
            log.warning("the Pi camera's automatics cannot be set: %s", error)
            return False
        return True


def _picamera2() -> Any:
    """The library; heavy, so imported where used.

    Raises:
        CameraError: it is not there, or does not fit to what is.

    """
    with _explained(
        "picamera2 cannot be imported: was a part of it built for another numpy? deploy/install.sh "
        "makes an environment that fits"
    ):
        try:
            # From Raspberry Pi OS's apt only.
            import picamera2  # pyright: ignore[reportMissingImports]
        except ImportError as error:
            raise CameraError(
                f"picamera2 cannot be imported ({error}): apt install python3-picamera2, and use "
                "a virtual environment with --system-site-packages (deploy/install.sh makes one); "
                "another camera needs none of it: deploy/install.sh --without-picamera2, and "
                'camera.source = "/dev/video0" or an address'
            ) from None
    return cast(Any, picamera2)


@contextmanager
def _explained(problem: str) -> Generator[None]:
    """Make a CameraError, in one line, of whatever picamera2 and libcamera raise: RuntimeError, but
    also ValueError (a numpy of another ABI), OSError, KeyError.
    """
    try:
        yield
    except CameraError:
        raise
    except Exception as error:
        reason = " ".join(f"{type(error).__name__} {error}".split())
        raise CameraError(f"{problem} ({reason})") from None


def _boottime_to_monotonic(boottime_ns: int) -> int:
    """libcamera stamps frames on CLOCK_BOOTTIME, which differs by the time spent suspended."""
    suspended_ns = time.clock_gettime_ns(time.CLOCK_BOOTTIME) - time.monotonic_ns()
    return min(boottime_ns - suspended_ns, time.monotonic_ns())
