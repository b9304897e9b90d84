import threading
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from mbot_agent.camera import capture as camera_module
from mbot_agent.camera.capture import CaptureThread
from mbot_agent.camera.frame_sources import OpenCvSource, frame_source, is_real_camera
from mbot_agent.camera.picture_check import REMEMBERED, PictureCheck
from mbot_agent.camera.source_contract import CameraError, Shot
from mbot_agent.configuration import CameraSettings

from .camera_bench import MILLISECOND, Encoded, noise


def video(path: Path, frames: int = 40, colour: tuple[int, int, int] | None = None) -> Path:
    """A short clip: noise, or one BGR colour."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 30.0, (64, 48))
    for seed in range(frames):
        frame = noise(seed) if colour is None else np.full((48, 64, 3), colour, np.uint8)
        writer.write(frame)
    writer.release()
    return path


def kind(check: PictureCheck, picture: np.ndarray, at_ms: float) -> str | None:
    fault = check.judge(picture, int(at_ms * MILLISECOND))
    return None if fault is None else fault.kind


def test_a_picture_that_changes_is_good() -> None:
    check = PictureCheck(CameraSettings())
    assert [kind(check, noise(k), k * 33) for k in range(20)] == [None] * 20


def test_black_and_nearly_black_pictures_are_refused() -> None:
    check = PictureCheck(CameraSettings())
    assert kind(check, noise(0) // 64, 0) == "camera-black"
    assert kind(check, np.zeros((48, 64, 3), np.uint8), 33) == "camera-black"
    assert kind(check, noise(1) // 8, 66) is None


@pytest.mark.parametrize(
    "picture",
    [noise(0, 50, 64), noise(0)[..., 0], noise(0).astype(np.float32), noise(0)[..., :2]],
)
def test_another_shape_than_before_is_refused(picture: np.ndarray) -> None:
    check = PictureCheck(CameraSettings())
    assert kind(check, noise(1), 0) is None
    assert kind(check, picture, 33) == "camera-wrong-shape"
    assert kind(check, noise(2), 66) is None


def test_a_configured_shape_is_held_from_the_first_frame() -> None:
    check = PictureCheck(CameraSettings(width_px=320, height_px=240))
    fault = check.judge(noise(0), 0)
    assert fault is not None
    assert "expected uint8 (240, 320, 3)" in fault.detail


def test_a_sensor_that_repeats_itself_is_frozen_after_300_ms() -> None:
    check = PictureCheck(CameraSettings(source="/dev/video0"))
    same = noise(0)
    kinds = [kind(check, same, k * 50) for k in range(8)]
    assert kinds == [None] * 6 + ["camera-frozen"] * 2
    assert kind(check, noise(1), 400) is None


def test_a_still_stream_is_believed_until_the_robot_drives(monkeypatch: pytest.MonkeyPatch) -> None:
    check = PictureCheck(CameraSettings(source="http://127.0.0.1/stream"))
    same = noise(0)
    assert kind(check, same, 0) is None
    assert kind(check, same, 60_000) is None
    monkeypatch.setattr(time, "monotonic_ns", lambda: 60_000 * MILLISECOND)
    check.drives(driving=True)
    assert kind(check, same, 60_900) is None
    assert kind(check, same, 61_000) == "camera-frozen"
    check.drives(driving=False)  # the motors were stopped, and still nothing changes
    assert kind(check, same, 70_000) == "camera-frozen"
    check.forgive()
    assert kind(check, same, 70_033) is None


@pytest.mark.parametrize("buffers", [2, 4, 6, REMEMBERED])
def test_a_ring_of_old_pictures_is_frozen_as_soon_as_nothing_new_has_come(buffers: int) -> None:
    check = PictureCheck(CameraSettings(source="/dev/video0"))
    kinds = [kind(check, noise(k % buffers), k * 50) for k in range(buffers + 8)]
    assert kinds == [None] * (buffers + 5) + ["camera-frozen"] * 3
    assert kind(check, noise(99), 5000) is None


def test_black_pictures_that_are_alike_are_called_black() -> None:
    check = PictureCheck(CameraSettings(source="/dev/video0"))
    kinds = [kind(check, np.full((48, 64, 3), k % 2, np.uint8), k * 50) for k in range(12)]
    assert kinds == ["camera-black"] * 12
    assert kind(check, noise(1), 600) is None


def test_a_stream_that_goes_round_is_found_when_the_robot_drives(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    check = PictureCheck(CameraSettings(source="http://127.0.0.1/stream"))
    for k in range(60):  # a simulated robot that stands, or that is turned to and fro
        assert kind(check, noise(k % 5), k * 100) is None
    monkeypatch.setattr(time, "monotonic_ns", lambda: 6_000 * MILLISECOND)
    check.drives(driving=True)
    kinds = [kind(check, noise(k % 5), 6_000 + k * 100) for k in range(12)]
    assert kinds == [None] * 10 + ["camera-frozen"] * 2


def test_a_picture_is_another_if_any_of_its_pixels_is() -> None:
    """A camera without noise, and a change between the rows that are looked at first."""
    check = PictureCheck(CameraSettings(identical_frames="refuse"))
    for k in range(20):
        picture = noise(0)
        picture[5, 7] = k
        assert kind(check, picture, k * 100) is None


def test_which_sources_have_a_sensor() -> None:
    for source in ("picamera2", "0", "/dev/video2"):
        assert is_real_camera(CameraSettings(source=source))
    for source in ("clip.mp4", "http://127.0.0.1:8090/stream.mjpg"):
        assert not is_real_camera(CameraSettings(source=source))


def test_colours_arrive_as_rgb(tmp_path: Path) -> None:
    clip = video(tmp_path / "red.avi", colour=(20, 10, 200))
    with OpenCvSource(CameraSettings(source=str(clip))) as source:
        shot = source.read()
    red, green, blue = shot.picture().reshape(-1, 3).mean(axis=0)
    assert red > 150
    assert max(green, blue) < 100
    assert shot.captured_ns <= time.monotonic_ns()


def test_a_missing_camera_is_explained() -> None:
    with pytest.raises(CameraError, match=r"cannot open the camera '/nothing\.mp4'"):
        frame_source(CameraSettings(source="/nothing.mp4")).__enter__()


def test_picamera2_is_explained_where_there_is_none() -> None:
    with pytest.raises(CameraError, match=r"apt install python3-picamera2.* --without-picamera2"):
        frame_source(CameraSettings()).__enter__()


def test_the_thread_keeps_the_newest_frame_and_reopens_an_ended_camera(tmp_path: Path) -> None:
    clip = video(tmp_path / "clip.avi", frames=12)
    with CaptureThread(CameraSettings(source=str(clip))) as capture:
        fault = capture.fault
        assert fault is not None
        assert fault.kind == "camera-starting"
        seen: set[int] = set()
        deadline = time.monotonic() + 10
        while time.monotonic() < deadline and len(seen) < 18:  # more than the clip has
            if (frame := capture.latest()) is not None:
                seen.add(frame.captured_ns)
                assert frame.picture.shape == (48, 64, 3)
            time.sleep(0.005)
        assert len(seen) >= 18


class HangingSource:
    """Delivers three frames, then hangs as a real camera does."""

    def __init__(self) -> None:
        self._left = 3

    def __enter__(self) -> "HangingSource":
        return self

    def __exit__(self, *_: object) -> None: ...

    def hold_light(self, held: bool) -> bool:
        return False

    def read(self) -> Shot:
        if self._left == 0:
            time.sleep(1.0)
            raise CameraError("the camera has stopped delivering frames")
        self._left -= 1
        time.sleep(0.02)
        return Shot.decoded(noise(self._left), time.monotonic_ns())


def test_a_hanging_camera_turns_stale_and_is_opened_again(monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[HangingSource] = []
    reopened = threading.Event()

    def source(_: CameraSettings) -> HangingSource:
        if opened:
            reopened.set()
        opened.append(HangingSource())
        return opened[-1]

    monkeypatch.setattr(camera_module, "frame_source", source)
    with CaptureThread(CameraSettings(source="0")) as capture:
        deadline = time.monotonic() + 5
        while not capture.is_fresh() and time.monotonic() < deadline:
            time.sleep(0.005)
        assert capture.is_fresh()
        while capture.is_fresh() and time.monotonic() < deadline:
            time.sleep(0.005)
        fault = capture.fault
        assert fault is not None
        assert fault.kind == "camera-stalled"
        assert reopened.wait(5)


def test_a_source_that_raises_what_nobody_thought_of_is_told_once(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    class Broken(HangingSource):
        def read(self) -> Shot:
            raise ZeroDivisionError("by a driver")

    monkeypatch.setattr(camera_module, "frame_source", lambda _: Broken())
    with CaptureThread(CameraSettings(source="0")) as capture:
        time.sleep(1.0)
        fault = capture.fault
    assert fault is not None
    assert (fault.kind, "ZeroDivisionError by a driver" in fault.detail) == ("camera-lost", True)
    assert sum(record.exc_info is not None for record in caplog.records) == 1


def test_a_picture_is_stale_after_what_is_configured(monkeypatch: pytest.MonkeyPatch) -> None:
    camera = Encoded(stale_after_ms=300)
    camera.sends()
    captured_ns = camera.capture._newest.captured_ns  # pyright: ignore
    for age_ms, fresh in ((0, True), (300, True), (301, False), (1000, False)):
        monkeypatch.setattr(
            time, "monotonic_ns", lambda age_ms=age_ms: captured_ns + age_ms * MILLISECOND
        )
        assert camera.capture.is_fresh() == fresh, age_ms
        fault = camera.capture.fault
        assert (fault and fault.kind) == (None if fresh else "camera-stalled")


def test_a_refused_frame_ends_freshness_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    black = threading.Event()

    class TurningBlack(HangingSource):
        def read(self) -> Shot:
            time.sleep(0.01)
            picture = np.zeros((48, 64, 3), np.uint8) if black.is_set() else noise(time.time_ns())
            return Shot.decoded(picture, time.monotonic_ns())

    monkeypatch.setattr(camera_module, "frame_source", lambda _: TurningBlack())
    with CaptureThread(CameraSettings(source="0")) as capture:
        deadline = time.monotonic() + 5
        while not capture.is_fresh() and time.monotonic() < deadline:
            time.sleep(0.002)
        black.set()
        while capture.is_fresh() and time.monotonic() < deadline:
            time.sleep(0.002)
        fault = capture.fault
        assert fault is not None
        assert fault.kind == "camera-black"
        assert capture.latest() is None


def test_most_pictures_are_never_decoded() -> None:
    camera = Encoded()
    for _ in range(40):
        camera.sends()
    assert camera.decoded == list(range(0, 40, 4))
    assert camera.capture.interval_ns == 33 * MILLISECOND


def test_the_picture_that_is_decided_on_is_decoded_once() -> None:
    camera = Encoded()
    for _ in range(3):
        camera.sends()
    for _ in range(2):
        frame = camera.capture.latest()
        assert frame is not None
        assert np.array_equal(frame.picture, noise(2))
    assert camera.decoded == [0, 2]


BLACK = np.zeros((48, 64, 3), np.uint8)
DAMAGED = np.zeros(0, np.uint8)


@pytest.mark.parametrize(
    ("bad", "fault"),
    [(BLACK, "camera-black"), (DAMAGED, "camera-damaged")],
    ids=["black", "damaged"],
)
def test_a_bad_picture_that_was_not_decoded_yet_is_never_decided_on(
    bad: np.ndarray, fault: str
) -> None:
    camera = Encoded()
    camera.sends()
    camera.sends(bad)
    assert camera.decoded == [0]
    assert camera.capture.latest() is None
    camera.sends(bad)  # looked at, since the one before was bad
    assert camera.fault == fault
    camera.sends(bad)
    assert camera.capture.latest() is None
    camera.sends()
    assert camera.fault is None
    assert camera.capture.latest() is not None


@pytest.mark.parametrize("bad", [BLACK, DAMAGED], ids=["black", "damaged"])
def test_bad_pictures_are_found_within_133_ms_though_nobody_decides(bad: np.ndarray) -> None:
    camera = Encoded()
    camera.sends()
    for _ in range(4):
        camera.sends(bad)
    assert camera.fault is not None
    assert camera.capture.latest() is None


def test_another_shape_is_found_without_decoding() -> None:
    camera = Encoded()
    camera.sends()
    camera.sends(shape=(48, 32, 3))
    assert camera.fault == "camera-wrong-shape"
    assert camera.capture.latest() is None
    assert camera.decoded == [0]


def test_a_repeating_stream_is_found_though_few_pictures_are_decoded() -> None:
    camera = Encoded(identical_frames="refuse")
    same = noise(7)
    for _ in range(9):
        camera.sends(same)
        assert camera.fault is None
    for _ in range(4):
        camera.sends(same)
    assert camera.fault == "camera-frozen"


def test_a_stream_in_a_ring_is_found_though_few_pictures_are_decoded() -> None:
    camera = Encoded(identical_frames="refuse")
    for number in range(60):
        camera.sends(noise(number % 6))
    assert camera.fault == "camera-frozen"
