"""The virtual robot as the daemon meets it: real pty, real HTTP, real MuJoCo, real time."""

import io
import json
import os
import signal
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import pytest
import serial

from mbot_protocol.drive.mcore import BAUD_RATE, Joystick
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.cli.virtual_robot import virtual_robot
from mbot_workstation.sim.body.robot_mjcf import HIDDEN_GROUP
from mbot_workstation.sim.camera.scene_renderer import TRAINING
from mbot_workstation.sim.scene.object_file import read_objects
from mbot_workstation.sim.scene.object_mjcf import DISTRACTORS
from mbot_workstation.sim.scene.room_generator import generate_room
from mbot_workstation.sim.scene.scene_parameters import Arena, SceneParameters
from mbot_workstation.tasks.fetch.episode import Happening
from mbot_workstation.tasks.fetch.lessons import FetchLesson
from mbot_workstation.virtual.camera_stream import CameraSettings
from mbot_workstation.virtual.live_report import LiveReport
from mbot_workstation.virtual.stand_in import VirtualRobot, VirtualRobotSettings
from mbot_workstation.virtual.virtual_session import Outputs, run_session

from ..ran import WORKSTATION
from ..until import until
from .called import output_of

ROOM = generate_room(0, 64)
CAMERA = CameraSettings(width_px=64, height_px=48, latency_s=0.01, quality=TRAINING)
FORWARD, LEFT_TURN = Joystick(-255, 255), Joystick(255, 255)
LIMIT_S = 30


def settings(**changes: object) -> VirtualRobotSettings:
    values = {"room_picture": ROOM, "camera": CAMERA, **changes}
    return VirtualRobotSettings(**values)  # pyright: ignore


@contextmanager
def running(**changes: object) -> Iterator[VirtualRobot]:
    with VirtualRobot(settings(**changes)) as robot:
        assert robot.wait_until_ready()
        yield robot


def test_a_command_on_the_port_moves_what_the_camera_sees() -> None:
    with running() as robot, serial.Serial(str(robot.board.path), BAUD_RATE, timeout=5) as port:
        capture = cv2.VideoCapture(robot.server.url)
        found, still = capture.read()
        assert found
        assert still.shape == (48, 64, 3)
        port.write(LEFT_TURN.to_bytes())
        assert port.read(4)
        assert until(lambda: abs(robot.world.status().robot.yaw_rad) > 0.5)
        assert robot.world.status().motors == LEFT_TURN
        assert robot.world.status().robot.yaw_rad > 0
        assert until(lambda: cv2.absdiff(capture.read()[1], still).mean() > 5)
        capture.release()


@pytest.mark.parametrize("task", ["line", "hidden", "bring"])
def test_what_a_task_puts_into_its_arena_is_there(task: str) -> None:
    with running(task=task) as robot:
        pieces, model = robot.world.pieces(), robot.simulation.model
        drawn = [model.geom(name) for name in DISTRACTORS[: len(pieces) + 1]]
    assert pieces
    for piece, geom in zip(pieces, drawn, strict=False):
        assert geom.group[0] != HIDDEN_GROUP
        assert geom.pos.tolist() == pytest.approx(piece.centre_m)
    assert drawn[-1].group[0] == HIDDEN_GROUP, "and nothing else"


def test_no_two_pictures_of_a_standing_robot_are_the_same() -> None:
    with running() as robot:
        capture = cv2.VideoCapture(robot.server.url)
        one, other = capture.read()[1], capture.read()[1]
        capture.release()
        assert cv2.absdiff(one, other).max() > 0


def test_its_object_is_the_one_it_was_told() -> None:
    (ball,) = read_objects(Path("models/objects/green-ball.toml"))
    lesson = FetchLesson("close", 0.5, spawn_half_angle_deg=6, objects=1)
    with running(scene=SceneParameters(objects=(ball,)), lesson=lesson) as robot:
        capture = cv2.VideoCapture(robot.server.url)
        blue, green, red = cv2.split(capture.read()[1].astype(int))
        capture.release()
        assert ((green - red > 40) & (green - blue > 40)).sum() > 30


def test_the_task_waits_until_somebody_drives() -> None:
    lesson = FetchLesson("short", 1.2, time_limit_s=0.05, ends_on_failure=False)
    with running(lesson=lesson) as robot:
        assert until(lambda: robot.world.status().time_s > 0.3)
        assert robot.world.status().result["duration_s"] == 0
        with serial.Serial(str(robot.board.path), BAUD_RATE) as port:
            port.write(FORWARD.to_bytes())
            event = robot.world.events.get(timeout=LIMIT_S)
        assert event.happening == Happening.TIME_OUT


def test_the_border_puts_it_back_and_it_drives_on() -> None:
    lesson = FetchLesson("endless", 0.5, objects=0, ends_on_failure=False)
    near = SceneParameters(arena=Arena(border_m=0.6))
    with (
        running(lesson=lesson, scene=near) as robot,
        serial.Serial(str(robot.board.path), BAUD_RATE) as port,
    ):
        port.write(FORWARD.to_bytes())
        while robot.world.events.get(timeout=LIMIT_S).happening != Happening.BORDER:
            pass
        assert robot.world.status().robot.x_m < 0.3
        assert robot.world.status().motors == FORWARD
        assert until(lambda: robot.world.status().robot.x_m > 0.1)


def test_a_failing_part_stops_the_whole_and_is_told() -> None:
    def fail(_stop: threading.Event) -> None:
        raise ConfigurationError("broken")

    with running() as robot:
        robot.run_beside("failing", fail)
        assert until(robot.stopped.is_set)
        with pytest.raises(ConfigurationError, match="broken"):
            robot.raise_failure()


def test_a_session_leaves_result_trajectory_and_film(tmp_path: Path) -> None:
    outputs = Outputs(tmp_path / "result.json", tmp_path / "path.jsonl", tmp_path / "film.mp4")
    lines = io.StringIO()
    lesson = FetchLesson("short", 1.2, time_limit_s=1.0, objects=0)
    board = tmp_path / "board"
    stop = threading.Event()

    def drive() -> None:
        assert until(board.is_symlink)
        with serial.Serial(str(board), BAUD_RATE) as port:
            port.write(LEFT_TURN.to_bytes())
            stop.wait(LIMIT_S)

    driver = threading.Thread(target=drive)
    driver.start()
    try:
        made = settings(lesson=lesson, board_link=board)
        result = run_session(made, outputs, LiveReport(as_json=True, stream=lines), stop, 20)
    finally:
        stop.set()
        driver.join()
    assert result["time_outs"] == 1
    assert json.loads((tmp_path / "result.json").read_text())["time_outs"] == 1
    path = [json.loads(line) for line in (tmp_path / "path.jsonl").read_text().splitlines()]
    assert {"t", "x", "y", "yaw", "object"} <= path[0].keys()
    assert [line["event"] for line in path if "event" in line] == ["time-out"]
    told = [json.loads(line) for line in lines.getvalue().splitlines()]
    assert told[0]["type"] == "ready"
    assert told[-1] == {"type": "result", **json.loads((tmp_path / "result.json").read_text())}
    capture = cv2.VideoCapture(str(tmp_path / "film.mp4"))
    assert capture.read()[1].shape == (480, 1120, 3)
    capture.release()


def test_the_command_is_ready_runs_and_ends_on_sigterm(tmp_path: Path) -> None:
    ready, board = tmp_path / "ready.json", tmp_path / "board"
    options = ["--board", str(board), "--camera-port", "0", "--ready-file", str(ready), "--plain"]
    with subprocess.Popen(
        [*WORKSTATION, "virtual-robot", *options, "--result", str(tmp_path / "result.json")],
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            assert until(lambda: ready.exists() or process.poll() is not None)
            told = json.loads(ready.read_text())
            assert told["board"] == str(board)
            assert cv2.VideoCapture(told["camera"]).read()[0]
            process.send_signal(signal.SIGTERM)
            assert process.wait(LIMIT_S) == 0
        finally:
            process.kill()
        assert process.stdout is not None
        assert "touched 0" in process.stdout.read()
    assert (tmp_path / "result.json").exists()
    assert not ready.exists()
    assert not os.path.lexists(board)


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--size", "big"], "--size is 'big', expected WIDTHxHEIGHT"),
        (["--radius", "3"], "--radius: objects up to 3 m away"),
        (["--panorama", "missing.jpg"], "panorama: can't read missing.jpg"),
        (["--view"], "--view needs a display"),
    ],
)
def test_what_can_not_be_is_said(
    options: list[str], told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for display in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(display, raising=False)
    with pytest.raises(ConfigurationError, match=told):
        output_of(virtual_robot, "--camera-port", "0", *options)
