"""`workstation robot new`: a folder that simulation and daemon take."""

import json
import shutil
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mbot_agent.board.board_kinds import opener
from mbot_agent.configuration import load
from mbot_agent.configuration_files import calibrated
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.cli.robot import new
from mbot_workstation.sim.calibrated.calibration_folder import CalibrationFiles, read_calibration
from mbot_workstation.sim.calibrated.new_robot import CONFIG, NewRobot
from mbot_workstation.sim.pose import ORIGIN
from mbot_workstation.sim.scene.room_generator import generate_room
from mbot_workstation.sim.simulation import Simulation

from .called import called, output_of

ROVER = ("rover", "--wheelbase", "150", "--wheel-diameter", "40", "--top-speed", "0.25")


@given(
    wheelbase_m=st.floats(0.06, 0.3),
    diameter_m=st.floats(0.02, 0.15),
    height_m=st.floats(0.02, 0.4),
    ahead_m=st.floats(-0.2, 0.3),
    mass_kg=st.floats(0.2, 2.5),
)
@settings(max_examples=50)
def test_whatever_may_be_given_can_be_simulated(
    wheelbase_m: float, diameter_m: float, height_m: float, ahead_m: float, mass_kg: float
) -> None:
    made = NewRobot(
        name="rover",
        board="gpio",
        wheelbase_m=wheelbase_m,
        wheel_diameter_m=diameter_m,
        top_speed_m_s=3 * diameter_m,
        camera_height_m=height_m,
        camera_ahead_m=ahead_m,
        camera_pitch_deg=10.0,
        mass_kg=mass_kg,
    )
    robot = CalibrationFiles(body=made.body(), motion=made.motion()).robot
    assert robot.mass_kg == pytest.approx(mass_kg, rel=1e-3)
    assert robot.track_m == wheelbase_m
    assert robot.wheel_radius_m == pytest.approx(diameter_m / 2, abs=1e-5)
    assert robot.camera_mount.height_m == height_m


def test_it_is_as_fast_as_it_was_said(tmp_path: Path) -> None:
    said = output_of(new, *ROVER, "-o", tmp_path)
    assert "122 rpm" in said
    simulated = Simulation(
        read_calibration(tmp_path).robot, room_picture=generate_room(seed=0, width_px=64)
    )
    simulated.place_robot(ORIGIN)
    simulated.set_duty(1, 1)
    simulated.step(1)
    start_m = simulated.pose.x_m
    simulated.step(2)
    assert (simulated.pose.x_m - start_m) / 2 == pytest.approx(0.25, abs=0.01)
    assert abs(simulated.pose.yaw_rad) < 1e-3


@pytest.mark.parametrize("kind", CONFIG)
def test_its_daemon_takes_the_folder(tmp_path: Path, kind: str) -> None:
    written = json.loads(output_of(new, *ROVER, "--board", kind, "-o", tmp_path / "made", "--json"))
    etc = tmp_path / "etc"
    for path in map(Path, written["files"]):
        place = etc if path.name == "config.toml" else etc / "calibration"
        place.mkdir(parents=True, exist_ok=True)
        shutil.copy(path, place)
    configuration = calibrated(load(etc / "config.toml"), etc / "config.toml")
    assert configuration.robot_id == "rover"
    assert configuration.board.kind == kind
    assert opener(configuration.board)
    assert configuration.motors.left.reversed is (kind == "mcore")
    assert not configuration.motors.right.reversed
    assert not configuration.board.accept_no_deadman


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--wheelbase", "0.15"), "--wheelbase [mm] is 0.15, expected 60 to 300"),
        (("--wheel-diameter", "nan"), "--wheel-diameter [mm] is nan"),
        (("--top-speed", "25"), "--top-speed [m/s] is 25.0, expected 0.07 to 2"),
        (("--mass", "0.9"), "--mass [g] is 0.9"),
        (("--board", "arduino"), "expected one of mcore, serial-line, gpio"),
    ],
)
def test_what_cannot_be_is_one_line(tmp_path: Path, words: tuple[str, ...], said: str) -> None:
    error = called(new, "rover", *words, "-o", tmp_path / "made").exception
    assert isinstance(error, ConfigurationError)
    assert said in str(error)
    assert "\n" not in str(error)
    assert not (tmp_path / "made").exists()


def test_a_robot_that_is_there_is_kept(tmp_path: Path) -> None:
    (tmp_path / "motion.toml").write_text("measured")
    error = called(new, "rover", "-o", tmp_path).exception
    assert "motion.toml exists already" in str(error)
    assert [path.name for path in tmp_path.iterdir()] == ["motion.toml"]
    assert "robot id is 'Rover 2'" in str(called(new, "Rover 2", "-o", tmp_path).exception)
