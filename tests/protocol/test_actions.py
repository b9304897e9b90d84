import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbot_protocol.drive.actions import STEP_LIMIT, MotorMap, Steps, WheelMaps, to_steps
from mbot_protocol.drive.mcore import Joystick

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
def test_a_motor_map_is_odd_and_stays_on_the_board(motor: MotorMap, step: int) -> None:
    speed = motor.to_board(step)
    assert -255 <= speed <= 255
    assert motor.to_board(-step) == -speed
    assert (speed == 0) == (step == 0)
    if step:
        assert abs(speed) >= motor.dead_band
        assert (speed < 0) == ((step > 0) == motor.reversed)


@given(maps, st.integers(0, STEP_LIMIT - 1))
def test_a_larger_step_is_never_slower(motor: MotorMap, step: int) -> None:
    assert abs(motor.to_board(step + 1)) >= abs(motor.to_board(step))


def test_forward_is_m1_negative_m2_positive() -> None:
    assert WheelMaps().to_board(Steps(250, 250)) == Joystick(-255, 255)


def test_trim_caps_the_stronger_motor() -> None:
    assert MotorMap(reversed=False, trim=0.8, dead_band=0).to_board(250) == 204


@pytest.mark.parametrize(("trim", "dead_band"), [(0.0, 0), (1.1, 0), (0.5, 128), (1.0, -1)])
def test_impossible_maps_are_refused(trim: float, dead_band: int) -> None:
    with pytest.raises(ValueError, match="expected"):
        MotorMap(reversed=False, trim=trim, dead_band=dead_band)
