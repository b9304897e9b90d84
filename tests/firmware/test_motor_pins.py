"""Speeds from registers: what goes into the timer comes out of `MotorPins`."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbot_protocol.drive.mcore import Joystick
from mbot_protocol.errors import MbotError
from mbot_workstation.virtual.emulated.motor_pins import MotorPins

OUTPUTS = 0xF0
SPEEDS = st.integers(-255, 255)


def registers(m1: int, m2: int, *, full_by_timer: bool) -> MotorPins:
    """What firmware sets for these speeds; Arduino's makes full speed without the timer."""
    tccr0a, portd = 3, 0
    for speed, direction, pwm, connected in (
        (m1, 1 << 7, 1 << 6, 2 << 6),
        (m2, 1 << 4, 1 << 5, 2 << 4),
    ):
        portd |= direction if speed >= 0 else 0
        if abs(speed) == 255 and not full_by_timer:
            portd |= pwm
        elif speed:
            tccr0a |= connected
    return MotorPins(0, abs(m1), abs(m2), tccr0a, portd, OUTPUTS)


@given(m1=SPEEDS, m2=SPEEDS, full_by_timer=st.booleans())
def test_every_speed_is_read_back(m1: int, m2: int, full_by_timer: bool) -> None:
    assert registers(m1, m2, full_by_timer=full_by_timer).joystick == Joystick(m1, m2)


def test_a_pin_that_is_an_input_drives_nothing() -> None:
    assert MotorPins(0, 200, 200, 0xA3, 0xF0, 0).joystick == Joystick(0, 0)


@pytest.mark.parametrize("tccr0a", [0xA1, 0xC3, 0xA2], ids=hex)
def test_another_mode_of_the_timer_is_not_guessed_at(tccr0a: int) -> None:
    with pytest.raises(MbotError, match=f"TCCR0A is {tccr0a:#04x}, expected fast PWM"):
        _ = MotorPins(0, 200, 200, tccr0a, 0, OUTPUTS).joystick
