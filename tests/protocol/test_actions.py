import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbot_protocol.drive.actions import LEVELS, STEP_LIMIT, MotorMap, Steps, WheelMaps, to_steps
from mbot_protocol.drive.mcore import Joystick
from mbot_protocol.drive.wheel_command import STOP, Duties, WheelCommand

steps = st.integers(-STEP_LIMIT, STEP_LIMIT)
maps = st.builds(
    MotorMap,
    reversed=st.booleans(),
    trim=st.floats(0.5, 1.0),
    dead_band=st.integers(0, 100),
)


@given(st.floats(-10, 10), st.floats(-10, 10))
def test_every_finite_action_becomes_one_of_501_steps(left: float, right: float) -> None:
    result = to_steps(left, right)
    for value, step in ((left, result.left), (right, result.right)):
        clipped = max(-1.0, min(1.0, value))
        assert abs(step - clipped * STEP_LIMIT) <= 0.5


def test_the_limits_are_the_papers() -> None:
    assert to_steps(1.0, -1.0) == Steps(250, -250)
    assert to_steps(0.0, -0.0) == Steps(0, 0)
    assert len({to_steps(k / 250, 0).left for k in range(-250, 251)}) == 501


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_number_that_is_none_never_becomes_a_step(bad: float) -> None:
    with pytest.raises(ValueError, match="finite"):
        to_steps(0.0, bad)


def test_steps_refuse_what_is_out_of_range() -> None:
    with pytest.raises(ValueError, match="right is 251"):
        Steps(0, 251)


@given(maps, steps)
def test_a_motor_map_is_odd_and_stays_within_full_drive(motor: MotorMap, step: int) -> None:
    duty = motor.duty(step)
    assert -1 <= duty <= 1
    assert motor.duty(-step) == -duty
    assert (duty > 0, duty < 0) == (step > 0, step < 0)
    if step:
        assert abs(duty) >= motor.dead_band / LEVELS


@given(maps, steps, st.floats(-1, 1))
def test_a_duty_is_told_as_the_step_that_it_came_from(
    motor: MotorMap, step: int, duty: float
) -> None:
    back = motor.step(motor.duty(step))
    assert motor.duty(back) == motor.duty(step)
    assert abs(motor.step(duty)) <= STEP_LIMIT, "of whatever a recording says"
    assert motor.step(-duty) == -motor.step(duty)


@given(maps, st.integers(0, STEP_LIMIT - 1))
def test_a_larger_step_is_never_slower(motor: MotorMap, step: int) -> None:
    assert motor.duty(step + 1) >= motor.duty(step)


def speed_before_duties(motor: MotorMap, step: int) -> int:
    """The board's speed as it was computed when commands still carried speeds."""
    if step == 0:
        return 0
    usable = 255 * motor.trim - motor.dead_band
    speed = round(motor.dead_band + usable * abs(step) / 250)
    return -speed if (step > 0) == motor.reversed else speed


any_map = st.builds(
    MotorMap,
    reversed=st.booleans(),
    trim=st.floats(0.05, 1.0),
    dead_band=st.integers(0, 12),
) | st.builds(
    MotorMap,
    reversed=st.booleans(),
    trim=st.floats(0.8, 1.0),
    dead_band=st.integers(0, 200),
)


@given(any_map, any_map)
def test_the_bytes_at_the_board_are_those_of_before_duties(left: MotorMap, right: MotorMap) -> None:
    """Of the 501 x 501 steps: each wheel's half of the frame depends on its own step only."""
    wheels = WheelMaps(left, right)
    for step in range(-STEP_LIMIT, STEP_LIMIT + 1):
        before = speed_before_duties(left, step), speed_before_duties(right, -step)
        duties = wheels.duties(Steps(step, -step))
        assert Joystick.of(wheels.at_motors(duties)).to_bytes() == Joystick(*before).to_bytes()
        assert wheels.levels(duties) == before
        assert (
            wheels.levels(Duties(*np.array((duties.left, duties.right), np.float32).tolist()))
            == before
        )
        assert wheels.of_levels(*before) == duties


def test_forward_is_m1_negative_m2_positive() -> None:
    wheels = WheelMaps()
    assert Joystick.of(wheels.at_motors(wheels.duties(Steps(250, 250)))) == Joystick(-255, 255)
    assert Joystick(-255, 255).duties == Duties(1, 1)


def test_trim_caps_the_stronger_motor() -> None:
    assert MotorMap(trim=0.8, dead_band=0).duty(250) == 0.8


def test_a_map_says_what_it_does_not_leave_to_the_robot_as_it_is_built() -> None:
    assert WheelMaps() == WheelMaps(MotorMap(reversed=True), MotorMap(reversed=False))
    turned = WheelMaps(MotorMap(reversed=False), MotorMap(reversed=True))
    assert turned.at_motors(Duties(0.5, 0.25)) == Duties(0.5, -0.25)


@pytest.mark.parametrize("bad", [math.nan, math.inf, 1.001, -1.001])
def test_a_duty_that_is_none_never_leaves(bad: float) -> None:
    for pair in ((bad, 0.0), (0.0, bad)):
        with pytest.raises(ValueError, match="expected a number in"):
            Duties(*pair)


def test_a_stop_is_both_wheels() -> None:
    assert STOP.is_stop
    assert not Duties(0.0, 0.1).is_stop
    assert not Duties(-0.1, 0.0).is_stop
    assert WheelCommand(STOP, 0).guard(), "a command without a guard holds"


@pytest.mark.parametrize(("trim", "dead_band"), [(0.0, 0), (1.1, 0), (0.5, 128), (1.0, -1)])
def test_impossible_maps_are_refused(trim: float, dead_band: int) -> None:
    with pytest.raises(ValueError, match="expected"):
        MotorMap(reversed=False, trim=trim, dead_band=dead_band)
