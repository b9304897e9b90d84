from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbot_workstation.sim.body.motor import motor_constants, motor_voltage
from mbot_workstation.sim.body.robot_parameters import MotorParameters, RobotParameters

MOTOR = MotorParameters(dead_band=0.2)
duty = st.floats(-1, 1)


def test_wheel_stands_in_the_dead_band_and_reaches_full_voltage() -> None:
    assert motor_voltage(0.2, MOTOR, 3.7) == 0
    assert 0 < motor_voltage(0.201, MOTOR, 3.7) < 0.02
    assert motor_voltage(1.0, MOTOR, 3.7) == pytest.approx(3.7)
    assert motor_voltage(1.0, replace(MOTOR, gain=0.5), 3.7) == pytest.approx(1.85)
    assert motor_voltage(7.0, MOTOR, 3.7) == pytest.approx(3.7)


@given(duty, duty)
def test_voltage_is_odd_and_never_falls_with_the_duty(one: float, other: float) -> None:
    low, high = sorted((one, other))
    assert motor_voltage(low, MOTOR, 3.7) <= motor_voltage(high, MOTOR, 3.7)
    assert motor_voltage(-one, MOTOR, 3.7) == -motor_voltage(one, MOTOR, 3.7)


@given(duty)
def test_a_motor_may_be_weaker_backward(duty: float) -> None:
    weaker = replace(MOTOR, backward_share=0.9)
    share = 0.9 if duty < 0 else 1.0
    expected = share * motor_voltage(duty, MOTOR, 3.7)
    assert motor_voltage(duty, weaker, 3.7) == pytest.approx(expected)


def test_constants_give_back_free_speed_and_time_constant() -> None:
    robot = RobotParameters()
    constants = motor_constants(robot, robot.left_motor)
    assert robot.supply_v / constants.constant_v_s == pytest.approx(robot.free_speed_rad_s)
    slower = motor_constants(robot, replace(robot.left_motor, time_constant_s=0.185))
    assert slower.resistance_ohm == pytest.approx(2 * constants.resistance_ohm)


@pytest.mark.parametrize(
    "wrong",
    [
        {"gain": 0},
        {"gain": float("nan")},
        {"backward_share": 0},
        {"dead_band": 1},
        {"time_constant_s": 0},
    ],
)
def test_impossible_motors_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="expected"):
        MotorParameters(**wrong)
