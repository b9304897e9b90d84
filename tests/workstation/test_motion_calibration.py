import math
from pathlib import Path

import msgspec
import pytest

from mbot_protocol.drive.calibration import MOTION_FILE, read_motor_mappings
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.sim.body.parameter_table import PARAMETERS, value
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.calibrated.calibration_folder import write_motion
from mbot_workstation.sim.calibrated.motion_calibration import (
    Interval,
    MotionCalibration,
    MotorCalibration,
    motion_value,
    read_motion,
)

from ..protocol.test_calibration import MOTION_TEXT
from .calibrations import MOTION


def test_a_file_is_read(tmp_path: Path) -> None:
    (tmp_path / MOTION_FILE).write_text(MOTION_TEXT)
    motion = read_motion(tmp_path)
    assert motion is not None
    assert motion.left_motor.dead_band == 52.5
    assert motion.track_m == 0.117
    assert motion.intervals == {"left_motor.gain": Interval(1.04, 1.06)}
    assert motion.undetermined == {"free_speed_rpm": "scales with both gains"}
    assert read_motion(tmp_path.parent) is None


def test_every_row_of_the_table_is_a_key_that_comes_back_as_the_robots(tmp_path: Path) -> None:
    """The way of a parameter: table -> motion.toml -> simulated robot, each at its upper limit."""
    keys: dict[str, dict[str, float]] = {"": {}, "left_motor": {}, "right_motor": {}}
    for one in PARAMETERS:
        section, _, key = one.file_key.rpartition(".")
        keys[section][key] = float(f"{one.file_factor * one.high:.6g}")
    written = MotionCalibration(
        left_motor=MotorCalibration(**keys["left_motor"]),
        right_motor=MotorCalibration(**keys["right_motor"]),
        **keys[""],
        latency_ms=20,
        made_on="2026-11-23",
    )
    write_motion(tmp_path, written)
    read = read_motion(tmp_path)
    assert read is not None
    assert read == written
    robot = read.robot(RobotParameters())
    for one in PARAMETERS:
        assert motion_value(read, one) == pytest.approx(one.high)
        assert value(robot, one.name) == pytest.approx(one.high)
    mappings = read_motor_mappings(tmp_path)
    assert mappings is not None
    assert mappings.wheel_maps() == robot.wheel_maps


def test_what_is_missing_is_as_the_body_has_it() -> None:
    bare = MotionCalibration(
        left_motor=MotorCalibration(),
        right_motor=MotorCalibration(),
        latency_ms=0,
        made_on="2026-11-23",
    )
    body = RobotParameters(track_m=0.2, wheel_friction=0.3)
    assert bare.robot(body) == body


MISTAKES = [
    ("wheel_radius_m = 0.0319", "wheel_radius_m = 31.9", "wheel_radius_m is 31.9, expected 0.01"),
    ("track_m = 0.117", "track_m = 117", "track_m is 117"),
    ("latency_ms = 31.0", "latency_ms = -1", "latency_ms is -1"),
    ("latency_ms = 31.0", "", "latency_ms is missing"),
    ("gain = 1.05", "gain = 105", "left_motor: gain is 105"),
    ("gain = 1.05", "gian = 1.05", "left_motor.gian is unknown (line 10); did you mean gain?"),
    ("dead_band = 47", "dead_band = 'much'", "right_motor.dead_band is 'much'"),
    ("time_constant_ms = 105.0", "time_constant_ms = 0.105", "time_constant_ms is 0.105"),
    ("low = 1.04", "low = 1.5", "low, high are 1.5, 1.06"),
]


@pytest.mark.parametrize(("old", "new", "words"), MISTAKES)
def test_a_mistake_names_its_side(tmp_path: Path, old: str, new: str, words: str) -> None:
    assert MOTION_TEXT.count(old) == 1
    (tmp_path / MOTION_FILE).write_text(MOTION_TEXT.replace(old, new))
    with pytest.raises(ConfigurationError) as caught:
        read_motion(tmp_path)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_value_out_of_range_is_refused_when_it_is_made_too() -> None:
    with pytest.raises(ValueError, match="dead_band is 300"):
        MotorCalibration(gain=1.0, dead_band=300, time_constant_ms=90)
    with pytest.raises(ValueError, match="track_m is nan"):
        msgspec.structs.replace(MOTION, track_m=math.nan)
    with pytest.raises(ValueError, match="low <= high"):
        Interval(math.nan, 1.0)
