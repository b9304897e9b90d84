from pathlib import Path
from typing import Any

import pytest

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.cli.virtual_robot import (
    ArenaKind,
    CameraKind,
    VirtualRobotOptions,
    outputs,
    replay_settings,
    robot_settings,
)
from mbot_workstation.sim.calibrated.calibration_folder import CalibrationFiles

from .calibrations import MOTION

FILES = CalibrationFiles()


def test_what_is_not_told_is_the_calibrations() -> None:
    files = CalibrationFiles(motion=MOTION)
    assert robot_settings(VirtualRobotOptions(), files).robot == files.robot
    told = robot_settings(VirtualRobotOptions(right_gain=0.5, dead_band=51), files).robot
    assert (told.left_motor.gain, told.right_motor.gain) == (files.robot.left_motor.gain, 0.5)
    assert told.left_motor.dead_band == told.right_motor.dead_band == pytest.approx(0.2)


def test_a_free_floor_has_no_wall_within_reach() -> None:
    arena = robot_settings(VirtualRobotOptions(free_floor=True), FILES).scene.arena
    assert min(arena.wall_m, arena.border_m) >= 100


def test_an_arena_is_nominal_unless_told_and_a_home_has_things_in_the_way() -> None:
    looks = {
        kind: robot_settings(VirtualRobotOptions(arena=kind, seed=3), FILES).look
        for kind in ArenaKind
    }
    usual, home = looks[ArenaKind.ANY], looks[ArenaKind.HOME]
    assert looks[ArenaKind.NOMINAL] is None
    assert usual is not None
    assert home is not None
    assert len(home.standing) > len(usual.standing) == 0


def test_a_pi_camera_has_automatics_and_a_fixed_one_none() -> None:
    seen = {
        kind: robot_settings(VirtualRobotOptions(camera=kind), FILES).camera.isp
        for kind in CameraKind
    }
    automatics = {
        kind: (isp.auto_exposure > 0, isp.auto_white_balance > 0) for kind, isp in seen.items()
    }
    assert automatics == {CameraKind.PI: (True, True), CameraKind.FIXED: (False, False)}


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"size": "640"}, "--size is '640'"),
        ({"size": "8x8"}, "--size is '8x8'"),
        ({"radius": 9.0}, "--radius"),
    ],
)
def test_what_is_out_of_range_is_named(changed: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigurationError, match=words):
        robot_settings(VirtualRobotOptions(**changed), FILES)


def test_noise_of_the_truth_has_bounds() -> None:
    assert outputs(VirtualRobotOptions()).tracker.position_noise_m == pytest.approx(0.004)
    with pytest.raises(ConfigurationError, match="--truth-noise is 101 mm"):
        outputs(VirtualRobotOptions(truth_noise=(101.0, 0.3)))


def test_what_only_a_simulation_has_is_refused_with_a_recording() -> None:
    camera = FILES.robot.camera
    with pytest.raises(ConfigurationError, match="--left-gain does nothing with --replay"):
        replay_settings(VirtualRobotOptions(left_gain=0.5), Path("drive"), camera)
