"""--calibration of the commands that simulate a robot."""

import json
import threading
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import serial

from mbot_protocol.drive.mcore import BAUD_RATE, Joystick
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.cli.evaluate import evaluate
from mbot_workstation.cli.train import train as train_command
from mbot_workstation.cli.virtual_robot import virtual_robot
from mbot_workstation.learn.learning.learner import LearnerSettings
from mbot_workstation.learn.learning.progress_display import LineDisplay
from mbot_workstation.learn.learning.training_config import TrainingConfig
from mbot_workstation.learn.learning.training_run import begin_run, train
from mbot_workstation.sim.calibrated.calibration_folder import (
    made_folder,
    read_files,
    write_camera,
    write_light,
    write_motion,
)
from mbot_workstation.sim.camera.camera_renderer import CameraRenderer
from mbot_workstation.sim.camera.isp import IspSettings
from mbot_workstation.sim.scene.room_generator import generate_room
from mbot_workstation.sim.scene.target_object import RED_CUBE
from mbot_workstation.sim.simulation import Simulation
from mbot_workstation.tasks.episode import Setting
from mbot_workstation.tasks.fetch.task import TASK
from mbot_workstation.virtual import virtual_session as session
from mbot_workstation.virtual.live_world import SLICE_S, LiveWorld
from mbot_workstation.virtual.mcore_board import McoreBoard
from mbot_workstation.virtual.stand_in import VirtualRobotSettings

from .calibrations import CAMERA, LIGHT, MOTION
from .called import called
from .small_world import ROOMS

FETCH = (TASK, TASK.play(None, None, ends_on_failure=True))
SETTING = Setting(contact_radius_m=0.09, border_m=2.9, footprints=(RED_CUBE.footprint,))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_camera(tmp_path / "mbot-1", CAMERA)
    write_motion(tmp_path / "mbot-1", MOTION)
    write_light(tmp_path / "mbot-1", LIGHT)
    rooms = made_folder(tmp_path / "mbot-1" / "rooms")
    cv2.imwrite(str(rooms / "kitchen.png"), np.full((64, 128, 3), (10, 200, 30), np.uint8))
    return tmp_path / "mbot-1"


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[VirtualRobotSettings]:
    """What `workstation virtual-robot` would run, instead of running it."""
    settings: list[VirtualRobotSettings] = []
    monkeypatch.setattr(session, "run_session", lambda made, *_: settings.append(made))
    return settings


def test_the_virtual_robot_is_the_calibrated_one(
    folder: Path, started: list[VirtualRobotSettings]
) -> None:
    assert called(virtual_robot, "--calibration", folder).exit_code == 0
    (made,) = started
    assert made.robot == read_files(folder).robot
    assert made.scene == read_files(folder).scene
    assert made.latency_s == 0.035
    assert made.camera.isp.gains == pytest.approx((0.8 * 1.1, 0.8, 0.8 * 0.9))
    assert (made.camera.width_px, made.camera.height_px) == (320, 240)
    assert made.room_picture is not None
    assert made.room_picture[0, 0].tolist() == [30, 200, 10]


def test_an_option_counts_more_than_the_calibration(
    folder: Path, started: list[VirtualRobotSettings]
) -> None:
    options = ("--right-gain", "0.5", "--dead-band", "51", "--distortion", "-0.2", "0.1")
    assert called(virtual_robot, "--calibration", folder, *options).exit_code == 0
    robot = started[0].robot
    assert (robot.left_motor.gain, robot.right_motor.gain) == (1.06, 0.5)
    assert robot.left_motor.dead_band == robot.right_motor.dead_band == pytest.approx(0.2)
    assert robot.left_motor.time_constant_s == 0.09
    assert robot.camera.distortion == (-0.2, 0.1, 0, 0, 0)
    assert robot.camera.focal_x_px == 1990.0


def test_without_a_calibration_it_is_the_nominal_one(started: list[VirtualRobotSettings]) -> None:
    assert called(virtual_robot).exit_code == 0
    nominal = VirtualRobotSettings()
    assert (started[0].robot, started[0].scene) == (nominal.robot, nominal.scene)
    assert (started[0].latency_s, started[0].camera.isp.gains) == (0.0, (1, 1, 1))
    assert (started[0].camera.width_px, started[0].camera.height_px) == (320, 240)


@pytest.mark.parametrize("command", [virtual_robot, train_command, evaluate])
def test_a_broken_calibration_is_named(folder: Path, command: Callable[..., None]) -> None:
    (folder / "motion.toml").write_text("track_m = 115")
    contestant = ("servo",) if command is evaluate else ()
    result = called(command, *contestant, "--calibration", folder)
    assert isinstance(result.exception, ConfigurationError)
    assert "motion.toml: left_motor is missing" in str(result.exception)


def test_a_policy_is_evaluated_on_the_calibrated_robot_in_its_room(folder: Path) -> None:
    options = ("--lesson", "1", "--episodes", "1", "--workers", "1", "--json")
    result = called(evaluate, "oracle", "--calibration", folder, *options)
    assert result.exit_code == 0, result.exception
    (line,) = json.loads(result.stdout)
    assert line["preset"] == "nominal"
    ideal = called(evaluate, "oracle", "--calibration", folder, "--preset", "ideal")
    assert "'ideal' is no real robot" in str(ideal.exception)


def test_a_run_that_goes_on_keeps_its_own_calibration(folder: Path, tmp_path: Path) -> None:
    result = called(train_command, "--resume", tmp_path, "--calibration", folder)
    assert "--panorama, --calibration and --object" in str(result.exception)


def test_a_guided_run_trains_on_the_calibrated_robot(folder: Path, tmp_path: Path) -> None:
    config = TrainingConfig(
        steps=32,
        robots=2,
        workers=1,
        preset="nominal",
        calibration=read_files(folder),
        made_up_rooms=1,
        learner=LearnerSettings(steps_per_robot=16, batch=16, epochs=1, guided_decisions=32),
    )
    run = begin_run(tmp_path / "run", config)
    assert train(run, config, LineDisplay(), threading.Event()).step == 32


def test_commands_reach_the_wheels_a_latency_later() -> None:
    simulation = Simulation(room_picture=ROOMS[0])
    with McoreBoard() as board:
        world = LiveWorld(simulation, board, *FETCH, SETTING, seed=0, latency_s=0.1)
        with serial.Serial(str(board.path), BAUD_RATE, timeout=10) as port:
            port.write(Joystick(-255, 255).to_bytes())
            assert port.read(4)
            speeds = []
            for _ in range(round(0.1 / SLICE_S) + 2):
                world.advance(time.monotonic())
                speeds.append(simulation.wheel_speeds_rad_s[0])
    assert max(np.abs(speeds[:-2])) < 0.2  # a robot put down settles on its wheels
    assert speeds[-1] > 0.5


def test_exposure_and_white_balance_show_in_the_pictures() -> None:
    simulation = Simulation(room_picture=generate_room(0, 64))
    with CameraRenderer(simulation, 64, 48) as plain:
        before = plain.picture(simulation.snapshot()).astype(float)
    with CameraRenderer(simulation, 64, 48, isp=IspSettings(gains=(0.5, 1.0, 1.3))) as tinted:
        after = tinted.picture(simulation.snapshot()).astype(float)
    assert np.allclose(after, np.minimum(before * (0.5, 1.0, 1.3), 255), atol=0.51)
