"""The film of a virtual robot, read back: real MuJoCo, real time, a real file."""

import threading
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from mbot_protocol.drive.picture import Picture
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.sim.camera.scene_renderer import TRAINING
from mbot_workstation.virtual.camera_stream import CameraSettings
from mbot_workstation.virtual.overhead_view import OverheadView
from mbot_workstation.virtual.stand_in import VirtualRobot, VirtualRobotSettings
from mbot_workstation.virtual.video_recorder import HEIGHT_PX, RATE_HZ, record

ROOM_RGB = (200, 60, 20)
CAMERA = CameraSettings(width_px=64, height_px=48, latency_s=0.01, quality=TRAINING)
CAMERA_WIDTH_PX = HEIGHT_PX * 4 // 3


@pytest.fixture(scope="module")
def robot() -> Iterator[VirtualRobot]:
    room = np.full((64, 128, 3), ROOM_RGB, np.uint8)
    with VirtualRobot(VirtualRobotSettings(room_picture=room, camera=CAMERA)) as robot:
        assert robot.wait_until_ready()
        yield robot


def film(robot: VirtualRobot, path: Path, seconds: float) -> None:
    """Record for about so long, in a thread as the session does."""
    stop = threading.Event()
    thread = threading.Thread(target=record, args=(robot, path, stop))
    thread.start()
    time.sleep(seconds)
    stop.set()
    thread.join()


def ended() -> threading.Event:
    """A wish to stop."""
    stop = threading.Event()
    stop.set()
    return stop


def pictures(path: Path) -> list[Picture]:
    """All of a film, RGB."""
    capture = cv2.VideoCapture(str(path))
    assert capture.get(cv2.CAP_PROP_FPS) == RATE_HZ
    found: list[Picture] = []
    while (shot := capture.read())[0]:
        found.append(np.asarray(cv2.cvtColor(shot[1], cv2.COLOR_BGR2RGB), np.uint8))
    capture.release()
    return found


def test_the_film_shows_what_the_camera_sees_beside_the_arena(
    robot: VirtualRobot, tmp_path: Path
) -> None:
    film(robot, tmp_path / "a.mp4", 0.5)
    picture = pictures(tmp_path / "a.mp4")[-1]
    assert picture.shape == (HEIGHT_PX, CAMERA_WIDTH_PX + HEIGHT_PX, 3)
    seen = robot.camera.newest
    assert seen is not None
    beside = cv2.resize(picture[:, :CAMERA_WIDTH_PX], (64, 48), interpolation=cv2.INTER_AREA)
    assert np.abs(beside.astype(float) - seen).mean() < 12
    # Colours that are exchanged would be something of 60 off.
    assert np.abs(beside.astype(float) - seen[..., ::-1]).mean() > 30
    from_above = picture[100:, CAMERA_WIDTH_PX:]
    assert from_above.std() > 5, "an empty picture"


def test_the_film_keeps_time_however_long_drawing_takes(
    robot: VirtualRobot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    draw, drawn_s = OverheadView.draw, list[float]()

    def slowly(*arguments: object) -> Picture:
        drawn_s.append(time.monotonic())
        time.sleep(0.25)
        return draw(*arguments)  # pyright: ignore[reportArgumentType]

    monkeypatch.setattr(OverheadView, "draw", slowly)
    film(robot, tmp_path / "a.mp4", 1.5)
    shown_s = len(pictures(tmp_path / "a.mp4")) / RATE_HZ
    assert shown_s == pytest.approx(drawn_s[-1] - drawn_s[0], abs=0.21)
    assert len(drawn_s) / RATE_HZ < shown_s / 2


def test_a_film_that_is_ended_at_once_has_a_picture(robot: VirtualRobot, tmp_path: Path) -> None:
    record(robot, tmp_path / "a.mp4", ended())
    assert len(pictures(tmp_path / "a.mp4")) == 1


@pytest.mark.parametrize("name", ["missing/a.mp4", "a.nonsense", "."])
def test_a_file_that_cannot_be_written_is_named(
    robot: VirtualRobot, tmp_path: Path, name: str
) -> None:
    with pytest.raises(ConfigurationError, match=r"can't write a film to .*writable NAME\.mp4"):
        record(robot, tmp_path / name, ended())
