import math
from dataclasses import replace

import numpy as np
import pytest

from mbot_workstation.sim.body.robot_mjcf import HIDDEN_GROUP
from mbot_workstation.sim.body.robot_parameters import MotorParameters, RobotParameters
from mbot_workstation.sim.pose import ORIGIN, Pose
from mbot_workstation.sim.scene.room_generator import generate_room
from mbot_workstation.sim.simulation import Simulation

ROOM = generate_room(seed=0, width_px=64)


def simulation(robot: RobotParameters | None = None) -> Simulation:
    return Simulation(robot, room_picture=ROOM)


@pytest.fixture(scope="module")
def nominal() -> Simulation:
    return simulation()


@pytest.fixture
def robot(nominal: Simulation) -> Simulation:
    nominal.place_robot(ORIGIN)
    return nominal


def turned_rad(robot: Simulation, seconds: float) -> float:
    yaw, total = robot.pose.yaw_rad, 0.0
    for _ in range(round(seconds / 0.05)):
        robot.step(0.05)
        total += math.remainder(robot.pose.yaw_rad - yaw, 2 * math.pi)
        yaw = robot.pose.yaw_rad
    return total


def test_no_marks_are_drawn(robot: Simulation) -> None:
    assert robot.model.nsite
    assert (robot.model.site_group == HIDDEN_GROUP).all()


def test_mass_is_what_the_parameters_say(robot: Simulation) -> None:
    assert robot.robot.mass_kg == pytest.approx(0.94)
    assert robot.model.body_mass.sum() == pytest.approx(0.94)


def test_full_duty_drives_straight_at_the_paper_speed(robot: Simulation) -> None:
    robot.set_duty(1, 1)
    robot.step(1)
    start = robot.pose
    robot.step(2)
    assert (robot.pose.x_m - start.x_m) / 2 == pytest.approx(0.40, abs=0.01)
    assert abs(robot.pose.y_m) < 1e-3
    assert abs(robot.pose.yaw_rad) < 1e-3


def test_opposite_duty_turns_on_the_spot_to_the_left(robot: Simulation) -> None:
    robot.set_duty(-1, 1)
    turned_rad(robot, 1)
    assert 6 < turned_rad(robot, 1) < 7
    assert math.hypot(robot.pose.x_m, robot.pose.y_m) < 0.01


def test_backward_is_the_mirror_of_forward(robot: Simulation) -> None:
    robot.set_duty(-0.7, -0.7)
    robot.step(2)
    backward = robot.pose.x_m
    robot.place_robot(ORIGIN)
    robot.set_duty(0.7, 0.7)
    robot.step(2)
    assert robot.pose.x_m == pytest.approx(-backward, abs=0.005)


def test_stands_in_the_dead_band_and_creeps_above_it(robot: Simulation) -> None:
    robot.set_duty(50 / 255, -50 / 255)
    robot.step(1)
    assert robot.pose.x_m == pytest.approx(0, abs=1e-3)
    robot.set_duty(60 / 255, 60 / 255)
    robot.step(1)
    assert 0.005 < robot.pose.x_m < 0.05


@pytest.mark.parametrize("time_constant_s", [0.08, 0.12])
@pytest.mark.parametrize("duty", [(1, 1), (-1, 1)])
def test_wheels_take_their_time_constant(time_constant_s: float, duty: tuple[int, int]) -> None:
    motor = MotorParameters(time_constant_s=time_constant_s)
    robot = simulation(RobotParameters(left_motor=motor, right_motor=motor))
    robot.step(0.2)  # the contacts take the weight
    robot.set_duty(*duty)
    robot.step(time_constant_s)
    after_one = robot.wheel_speeds_rad_s[1]
    robot.step(2)
    assert after_one / robot.wheel_speeds_rad_s[1] == pytest.approx(1 - 1 / math.e, abs=0.07)


def test_zero_duty_brakes(robot: Simulation) -> None:
    robot.set_duty(1, 1)
    robot.step(1)
    moving = robot.pose.x_m
    robot.set_duty(0, 0)
    robot.step(1)
    assert robot.pose.x_m - moving == pytest.approx(0.4 * 0.09, abs=0.015)
    assert np.allclose(robot.wheel_speeds_rad_s, 0, atol=0.05)


def test_a_weak_right_motor_pulls_to_the_right() -> None:
    weak = replace(RobotParameters().right_motor, gain=0.5)
    robot = simulation(RobotParameters(right_motor=weak))
    robot.set_duty(1, 1)
    robot.step(1)
    assert robot.pose.yaw_rad < -0.5


def test_a_full_reversal_does_not_tip_it_over(robot: Simulation) -> None:
    for duty in (1, -1, 1):
        robot.set_duty(duty, duty)
        for _ in range(10):
            robot.step(0.05)
            up = robot.snapshot().joints[3:7]
            assert abs(up[2]) < 0.02, "pitched by more than 2 degrees"


def test_walls_stop_it(robot: Simulation) -> None:
    robot.place_robot(Pose(2.5, 0, 0))
    robot.set_duty(1, 1)
    robot.step(4)
    assert 2.85 < robot.pose.x_m < 2.95


@pytest.mark.parametrize("pose", [Pose(1, -2, 0.5), Pose(-0.3, 0.1, -3.0)])
def test_is_placed_where_it_is_told_and_stands(robot: Simulation, pose: Pose) -> None:
    robot.set_duty(1, 1)
    robot.step(0.5)
    robot.place_robot(pose)
    robot.step(0.5)
    found = robot.pose
    assert (found.x_m, found.y_m) == pytest.approx((pose.x_m, pose.y_m), abs=1e-3)
    assert found.yaw_rad == pytest.approx(pose.yaw_rad, abs=1e-3)


def test_time_is_kept_over_odd_durations(robot: Simulation) -> None:
    start_s = robot.time_s
    for _ in range(300):
        robot.step(1 / 30)
    assert robot.time_s - start_s == pytest.approx(10, abs=0.0051)


def test_a_snapshot_does_not_change_afterwards(robot: Simulation) -> None:
    before = robot.snapshot()
    robot.set_duty(1, 1)
    robot.step(0.5)
    robot.place_object(Pose(2, 2, 1))
    robot.turn_room(1)
    after = robot.snapshot()
    assert before.joints[0] == 0 < after.joints[0]
    assert not np.allclose(before.moved_pos, after.moved_pos)
    assert not np.allclose(before.moved_quat, after.moved_quat)


def test_a_push_moves_it_sideways_and_nothing_else(robot: Simulation) -> None:
    robot.set_duty(1, 1)
    robot.step(1)
    before, speeds = robot.pose, robot.wheel_speeds_rad_s
    seen = robot.snapshot().robot  # a physics step further
    pushed = robot.push(-0.03, 0.02)
    assert pushed == robot.pose, "known before the next step"
    expected = (before.x_m - 0.03, before.y_m + 0.02)
    assert (pushed.x_m, pushed.y_m) == pytest.approx(expected, abs=1e-12)
    assert pushed.yaw_rad == before.yaw_rad
    assert robot.wheel_speeds_rad_s == speeds
    assert robot.snapshot().robot.x_m == pytest.approx(seen.x_m - 0.03, abs=1e-12)
    robot.step(0.5)
    assert robot.pose.x_m == pytest.approx(pushed.x_m + 0.2, abs=0.01), "it drives on from there"
    assert robot.pose.y_m == pytest.approx(pushed.y_m, abs=0.005)
