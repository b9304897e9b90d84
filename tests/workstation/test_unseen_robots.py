"""The simulators that try the identification: physics that must hold whatever their parameters."""

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))

from brush_robot import BrushRobot
from carpet_robot import CarpetRobot
from unseen_robot import TOLD_S, UnseenRobot

pytestmark = pytest.mark.slow

EVEN: dict[str, UnseenRobot] = {
    "brush": BrushRobot(
        constant=(0.0051, 0.0051),
        resistance=(6.0, 6.0),
        contact_v=(0.1, 0.1),
        stick=(7e-4, 7e-4),
        kinetic=(4e-4, 4e-4),
    ),
    "carpet": CarpetRobot(
        radius=(0.0325, 0.0325),
        top=(12.6, 12.6),
        backward=(1, 1),
        lag=(0.04, 0.04),
        nap=0,
        incline=0,
    ),
}
"""Both wheels alike, on a level floor without a direction."""


def drive(robot: UnseenRobot, left: float, right: float, **changed: Any) -> tuple[Any, Any]:
    """Two seconds from standstill, caster straight, battery full: poses and speeds."""
    duty = np.tile([left, right], (1, round(2 / TOLD_S), 1)).astype(np.float64)
    calm = replace(robot, ageing=0.0, **changed)
    poses, speeds = calm.drive(duty, np.ones_like(duty), np.zeros((1, 4)), np.zeros((1, 2)))
    return poses[0], speeds[0]


@pytest.mark.parametrize("name", EVEN)
def test_an_even_robot_drives_straight_and_mirrors_its_turns(name: str) -> None:
    robot = EVEN[name]
    poses, speeds = drive(robot, 1, 1)
    assert abs(poses[-1, 1]) < 1e-6
    assert 0.3 < speeds[-1, 0] < 0.5  # the paper's mBot drives 0.41 m/s
    left, right = drive(robot, 0, 1)[1][-1], drive(robot, 1, 0)[1][-1]
    assert left == pytest.approx(right * [1, -1], abs=1e-6)
    assert left[1] > 1


@pytest.mark.parametrize("name", EVEN)
def test_it_stands_without_voltage_and_stops_when_it_ends(name: str) -> None:
    robot = replace(EVEN[name], ageing=0.0)
    duty = np.zeros((1, round(3 / TOLD_S), 2))
    poses, _ = robot.drive(duty, np.ones_like(duty), np.zeros((1, 4)), np.zeros((1, 2)))
    assert np.abs(poses).max() < 1e-4
    duty[:, : round(1 / TOLD_S)] = 1
    _, speeds = robot.drive(duty, np.ones_like(duty), np.zeros((1, 4)), np.zeros((1, 2)))
    assert abs(speeds[0, -1, 0]) < 0.01


@pytest.mark.parametrize("name", EVEN)
def test_half_the_step_changes_little(name: str) -> None:
    robot = EVEN[name]
    for left, right in ((1, 1), (1, -1), (0, 1)):
        coarse = drive(robot, left, right)[1][-500:].mean(axis=0)
        fine = drive(robot, left, right, step_s=robot.step_s / 2)[1][-500:].mean(axis=0)
        assert coarse == pytest.approx(fine, rel=0.01, abs=0.002)


@pytest.mark.parametrize("name", EVEN)
def test_wheels_do_not_push_beyond_their_grip(name: str) -> None:
    robot = EVEN[name]
    limit = {"brush": 0.3, "carpet": 0.3}[name]
    changed = {"grip": limit} if name == "brush" else {"sticking": limit, "sliding": limit}
    _, speeds = drive(robot, 1, 1, **changed)
    gained = np.diff(speeds[:, 0]) / TOLD_S
    assert np.convolve(gained, np.ones(40) / 40, "valid").max() < limit * 9.81 * 1.05
