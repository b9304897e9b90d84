"""A motor driver on the pins, tried against gpiozero's own mock pins."""

import os
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import pytest
from gpiozero import Device
from gpiozero.pins.mock import MockFactory, MockPWMPin

from mbot_agent.board import board_kinds
from mbot_agent.board.board_session import BoardLostError, BoardSession
from mbot_agent.board.gpio.gpio_session import GpioSession
from mbot_agent.board.motor_stop import stop_motors
from mbot_agent.board.motors import Motors
from mbot_agent.configuration import BoardSettings, GpioSettings
from mbot_protocol.drive.actions import MotorMap, WheelMaps
from mbot_protocol.drive.wheel_command import Duties, WheelCommand
from mbot_protocol.errors import UnreachableError

from ..until import until

SETTINGS = BoardSettings(kind="gpio", gpio=GpioSettings(enable=(25,)))
OFF = [0.0, 0.0, 0.0, 0.0]


class Pins:
    """What the driver's inputs see, by the numbers of the configuration."""

    def __init__(self, factory: Any) -> None:
        self._factory = factory

    @property
    def duties(self) -> list[float]:
        return [float(self._factory.pin(n).state) for n in (17, 27, 22, 23)]

    @property
    def enable(self) -> bool:
        return bool(self._factory.pin(25).state)


@pytest.fixture
def pins(monkeypatch: pytest.MonkeyPatch) -> Iterator[Pins]:
    factory: Any = MockFactory(pin_class=MockPWMPin)
    monkeypatch.setattr(Device, "pin_factory", factory)
    yield Pins(factory)
    factory.reset()


def test_both_wheels_turn_both_ways_and_stand_at_the_end(pins: Pins) -> None:
    session: BoardSession = board_kinds.opener(SETTINGS)(SETTINGS, None)
    with session:
        assert session.firmware.version == ""
        session.send(Duties(1.0, 1.0))
        assert session.handshake(lambda: False)
        assert pins.duties == OFF
        assert session.path == "GPIO 17, 27, 22, 23, 25"
        assert session.firmware.version.startswith("gpiozero 2")
        assert not session.firmware.has_deadman
        assert not session.firmware.may_latch
        assert pins.enable
        began_ns = time.monotonic_ns()
        written_ns, done_ns = session.send(Duties(0.5, -0.25))
        assert began_ns <= written_ns <= done_ns
        assert pins.duties == [0.5, 0.0, 0.0, 0.25]
        session.send(Duties(-1.0, 1.0))
        assert pins.duties == [0.0, 1.0, 1.0, 0.0]
        session.stop()
        assert pins.duties == OFF
        session.arm()
        session.send(Duties(1.0, 1.0))
    assert pins.duties == OFF
    assert not pins.enable


@pytest.mark.parametrize("error", [ValueError("any"), BoardLostError("any")])
def test_whatever_ends_it_stops_the_motors(pins: Pins, error: Exception) -> None:
    with suppress(type(error)), GpioSession.open(SETTINGS, None) as session:
        session.send(Duties(1.0, 1.0))
        raise error
    assert pins.duties == OFF
    with GpioSession.open(SETTINGS, None):
        pass  # the pins were given back


def test_it_stops_before_it_lets_go(pins: Pins, monkeypatch: pytest.MonkeyPatch) -> None:
    """A pin that nobody holds floats."""
    said = list[str]()
    monkeypatch.setattr(MockPWMPin, "close", lambda _: said.append(str(pins.duties == OFF)))
    with GpioSession.open(SETTINGS, None) as session:
        session.send(Duties(1.0, 1.0))
        monkeypatch.setattr(session, "stop", lambda: said.append("stop"))
    assert said[0] == "stop"


def test_pins_in_use_and_pins_that_fail_are_named(
    pins: Pins, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = GpioSession.open(SETTINGS, None)
    with pytest.raises(UnreachableError, match=r"GPIO 17, .*PinInUse"):
        GpioSession.open(SETTINGS, None)
    monkeypatch.setattr(MockPWMPin, "_set_state", None)
    for act in (lambda: session.send(Duties(1.0, 1.0)), lambda: session.__exit__(*3 * [None])):
        with pytest.raises(BoardLostError, match="GPIO 17, "):
            act()


def test_without_gpiozero_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gpiozero", None)
    with pytest.raises(UnreachableError, match="apt install python3-gpiozero"):
        GpioSession.open(SETTINGS, None)


def test_waiting_ends_with_its_time_or_a_wake_up(pins: Pins) -> None:
    reader, writer = os.pipe()
    with GpioSession.open(SETTINGS, reader) as session:
        began_s = time.monotonic()
        session.wait(0.1)
        session.wait(-1.0)
        assert 0.09 < time.monotonic() - began_s < 2.0
        os.write(writer, b"x")
        session.wait(60.0)
    os.close(reader)
    os.close(writer)
    with GpioSession.open(SETTINGS, None) as session:
        session.wait(0.0)  # nobody wakes it


def test_the_motor_thread_refuses_it_unless_it_is_accepted(pins: Pins) -> None:
    with Motors(SETTINGS) as motors:
        assert until(lambda: motors.fault is not None and motors.fault.kind == "board-no-deadman")
    accepted = BoardSettings(kind="gpio", accept_no_deadman=True)
    wheels = WheelMaps(MotorMap(reversed=False), MotorMap())
    with Motors(accepted, wheels) as motors:
        assert until(lambda: motors.fault is None)
        motors.drive(WheelCommand(Duties(0.5, 0.5), time.monotonic_ns() + 400_000_000))
        assert until(lambda: pins.duties == [0.5, 0.0, 0.5, 0.0])
        assert until(lambda: pins.duties == OFF, 3), "its deadline"
        motors.drive(WheelCommand(Duties(0.5, 0.5), time.monotonic_ns() + 10**10))
        assert until(lambda: pins.duties != OFF)
    assert pins.duties == OFF


def test_stop_motors_takes_pins_that_a_killed_daemon_has_left_high(pins: Pins) -> None:
    left: Any = Device.pin_factory
    left.pin(17).function = "output"
    left.pin(17).state = 1
    stop_motors(SETTINGS)
    assert pins.duties == OFF
