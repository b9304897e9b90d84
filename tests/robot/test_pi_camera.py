"""The Pi camera's source against a stand-in for picamera2, which only a Raspberry Pi has."""

import sys
import time
from pathlib import Path
from types import ModuleType
from typing import NoReturn

import numpy as np
import pytest

from mbot_agent.camera.capture import CaptureThread
from mbot_agent.camera.pi_camera_source import SENSOR_MODE, PiCameraSource
from mbot_agent.camera.source_contract import CameraError
from mbot_agent.configuration import CameraSettings

from ..end_to_end.processes import until


class StandInRequest:
    def __init__(self, captured_ns: int) -> None:
        self.captured_ns = captured_ns
        self.released = False

    def make_array(self, stream: str) -> np.ndarray:
        assert stream == "main"
        return np.random.default_rng().integers(0, 256, (240, 320, 3), np.uint8)

    def get_metadata(self) -> dict[str, int]:
        return {"SensorTimestamp": self.captured_ns}

    def release(self) -> None:
        self.released = True


class StandIn:
    """As much of picamera2.Picamera2 as the daemon uses."""

    cameras: list[dict[str, str]]
    pixel_format: str
    busy: bool
    newest: "StandIn"
    opened: list["StandIn"]

    def __init__(self) -> None:
        assert all(before.closed for before in StandIn.opened), "libcamera gives one at a time"
        self.configuration: dict[str, object] = {}
        self.requests: list[StandInRequest] = []
        self.hangs = False
        self.controls: list[dict[str, object]] = []
        self.refuses = False
        self.closed = False
        StandIn.newest = self
        StandIn.opened.append(self)

    @staticmethod
    def global_camera_info() -> list[dict[str, str]]:
        return StandIn.cameras

    def create_video_configuration(self, **settings: object) -> dict[str, object]:
        return settings

    def configure(self, configuration: dict[str, object]) -> None:
        self.configuration = configuration

    def camera_configuration(self) -> dict[str, object]:
        return self.configuration | {"main": {"format": StandIn.pixel_format}}

    def start(self) -> None:
        if StandIn.busy:
            raise RuntimeError("Failed to start camera: Device or resource busy")

    def capture_request(self, wait: float) -> StandInRequest:
        assert 0 < wait <= 2
        if self.hangs:
            raise TimeoutError
        captured_ns = time.clock_gettime_ns(time.CLOCK_BOOTTIME) - 50_000_000
        self.requests.append(StandInRequest(captured_ns))
        return self.requests[-1]

    def set_controls(self, controls: dict[str, object]) -> None:
        if self.refuses:
            raise RuntimeError("Control AwbEnable is not advertised by libcamera")
        self.controls.append(controls)

    def close(self) -> None:
        self.closed = True


@pytest.fixture(autouse=True)
def picamera2(monkeypatch: pytest.MonkeyPatch) -> None:
    module = ModuleType("picamera2")
    module.Picamera2 = StandIn  # pyright: ignore[reportAttributeAccessIssue]
    monkeypatch.setitem(sys.modules, "picamera2", module)
    StandIn.cameras = [{"Model": "imx477"}]
    StandIn.pixel_format = "BGR888"
    StandIn.busy = False
    StandIn.opened = []


def test_the_full_view_mode_is_pinned_and_the_colour_order_asked_for() -> None:
    with PiCameraSource(CameraSettings()):
        configuration = StandIn.newest.configuration
        # picamera2 names formats backwards: BGR888 lies as R, G, B in memory.
        assert configuration["main"] == {"size": (320, 240), "format": "BGR888"}
        assert configuration["sensor"] == {"output_size": SENSOR_MODE, "bit_depth": 12}
        assert configuration["controls"] == {"FrameRate": 30.0}
    assert StandIn.newest.closed


def test_frames_carry_the_sensors_time_on_our_clock_and_are_given_back() -> None:
    with PiCameraSource(CameraSettings()) as source:
        shot = source.read()
        age_ms = (time.monotonic_ns() - shot.captured_ns) / 1e6
    assert shot.picture().shape == (240, 320, 3)
    assert 49 <= age_ms < 2000
    assert StandIn.newest.requests[0].released


def test_a_configured_size_is_asked_of_the_isp() -> None:
    with PiCameraSource(CameraSettings(width_px=640, height_px=480)):
        main = StandIn.newest.configuration["main"]
    assert main == {"size": (640, 480), "format": "BGR888"}


def test_a_hanging_camera_is_an_error_in_time() -> None:
    with PiCameraSource(CameraSettings()) as source:
        StandIn.newest.hangs = True
        with pytest.raises(CameraError, match="delivers no frames"):
            source.read()


def test_a_hung_camera_is_closed_and_restarted() -> None:
    with CaptureThread(CameraSettings()) as capture:
        assert until(capture.is_fresh)
        first = StandIn.newest
        first.hangs = True
        assert until(lambda: StandIn.newest is not first)
        assert until(capture.is_fresh)
        assert first.closed
        assert StandIn.newest is not first
    assert StandIn.newest.closed


@pytest.mark.parametrize("error", ["ValueError", "OSError", "RuntimeError", "AttributeError"])
def test_a_library_that_does_not_load_is_told_in_one_line_once(
    error: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """A numpy of another ABI raises ValueError, and is the commonest."""
    (tmp_path / "picamera2.py").write_text(f"raise {error}('numpy.dtype size\\nchanged')")
    monkeypatch.delitem(sys.modules, "picamera2")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(CameraError, match=rf"another numpy.*\({error} numpy.dtype size changed"):
        PiCameraSource(CameraSettings()).__enter__()
    assert_one_warning(caplog)


@pytest.mark.parametrize("call", ["global_camera_info", "close", "create_video_configuration"])
def test_whatever_the_library_raises_is_a_camera_that_is_lost(
    call: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def fails(*_: object, **__: object) -> NoReturn:
        raise RuntimeError("the camera manager does not start")

    StandIn.busy = True
    monkeypatch.setattr(StandIn, call, fails)
    monkeypatch.setattr(StandIn, "opened", [])
    assert_one_warning(caplog)


def assert_one_warning(caplog: pytest.LogCaptureFixture) -> None:
    """However often the camera is tried."""
    with CaptureThread(CameraSettings()) as capture:
        assert until(lambda: capture.fault is not None and capture.fault.kind == "camera-lost")
        time.sleep(1.0)
    assert len(caplog.records) == 1
    assert caplog.records[0].exc_info is None


def test_a_frame_without_its_time_is_no_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    with PiCameraSource(CameraSettings()) as source:
        monkeypatch.setattr(StandInRequest, "get_metadata", lambda _: {})
        with pytest.raises(CameraError, match=r"no frames.*KeyError 'SensorTimestamp'"):
            source.read()
        assert StandIn.newest.requests[0].released


def test_no_camera_on_the_cable_is_explained() -> None:
    StandIn.cameras = []
    with pytest.raises(CameraError, match="check the cable"):
        PiCameraSource(CameraSettings()).__enter__()


def test_a_camera_of_another_format_is_closed_and_refused() -> None:
    StandIn.pixel_format = "YUYV"
    with pytest.raises(CameraError, match="gives YUYV"):
        PiCameraSource(CameraSettings()).__enter__()
    assert StandIn.newest.closed


def test_a_camera_that_does_not_start_is_closed_for_the_next_attempt() -> None:
    StandIn.busy = True
    with pytest.raises(CameraError, match=r"is another program using it\? .*resource busy"):
        PiCameraSource(CameraSettings()).__enter__()
    assert StandIn.newest.closed


def test_the_light_is_held_and_let_go() -> None:
    with PiCameraSource(CameraSettings()) as source:
        assert source.hold_light(True)
        assert source.hold_light(False)
        assert StandIn.newest.controls == [
            {"AeEnable": False, "AwbEnable": False},
            {"AeEnable": True, "AwbEnable": True},
        ]


def test_a_camera_without_these_controls_drives_on_and_says_so(
    caplog: pytest.LogCaptureFixture,
) -> None:
    with PiCameraSource(CameraSettings()) as source:
        StandIn.newest.refuses = True
        assert not source.hold_light(True)
        assert "AwbEnable is not advertised" in caplog.text
