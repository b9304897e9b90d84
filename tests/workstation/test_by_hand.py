"""A gamepad, a terminal's keys, and what becomes of them. The gamepad's device is a pipe."""

import os
import pty
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import pytest
from typer.testing import CliRunner

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.v1.messages_pb2 import Command
from mbot_workstation.cli.subcommands import app as workstation
from mbot_workstation.fleet.by_hand import gamepad as pads
from mbot_workstation.fleet.by_hand.gamepad import (
    ABS_X,
    ABS_Y,
    BTN_SOUTH,
    EV_ABS,
    EV_KEY,
    EV_SYN,
    SYN_DROPPED,
    Gamepad,
    GamepadState,
    open_gamepad,
)
from mbot_workstation.fleet.by_hand.hand import HandInput, Wish, mixed
from mbot_workstation.fleet.by_hand.hand_session import HandSession
from mbot_workstation.fleet.by_hand.terminal_keys import (
    FIRST_REPEAT_WITHIN_S,
    HELD_FOR_S,
    HELD_UP_WITHIN_S,
    KeyRepeats,
    TerminalKeys,
    split_keys,
)
from mbot_workstation.fleet.link.remote_control import RemoteControl
from mbot_workstation.fleet.link.robot_link import RobotLink

from ..until import until
from .fake_robot import FakeRobot

RANGES = {ABS_X: (-32768, 32767), ABS_Y: (-32768, 32767)}
UP = -32768
SHORTEST_S = 0.002


@dataclass(frozen=True)
class Event:
    type: int
    code: int
    value: int


class PipedPad:
    """A gamepad's device file as a pipe: three numbers a line."""

    def __init__(self) -> None:
        self._reading, self._writing = os.pipe()

    def press(self, code: int, value: int = 1) -> None:
        self.happens(EV_KEY, code, value)

    def happens(self, *event: int) -> None:
        os.write(self._writing, (" ".join(map(str, event)) + "\n").encode())

    def unplug(self) -> None:
        os.close(self._writing)

    def fileno(self) -> int:
        return self._reading

    def read(self) -> list[Event]:
        if not (data := os.read(self._reading, 4096)):
            raise OSError(19, "No such device")
        return [Event(*map(int, line.split())) for line in data.decode().splitlines()]


@pytest.fixture
def pad() -> PipedPad:
    return PipedPad()


def test_the_stick_does_nothing_without_the_button() -> None:
    state = GamepadState(RANGES)
    state.take(Event(EV_ABS, ABS_Y, UP))
    assert state.wish() == Wish()
    state.take(Event(EV_KEY, pads.HOLD, 1))
    assert state.wish().wheels == pytest.approx((1, 1))
    state.take(Event(EV_KEY, pads.HOLD, 0))
    assert state.wish() == Wish()


def test_a_button_held_before_or_while_events_were_lost_holds_nothing() -> None:
    state = GamepadState(RANGES)
    state.take(Event(EV_KEY, pads.HOLD, 2))  # the kernel's own repeat of one pressed before
    assert state.wish().wheels is None
    state.take(Event(EV_KEY, pads.HOLD, 1))
    state.take(Event(EV_KEY, pads.HOLD, 2))
    assert state.wish().wheels is not None
    state.take(Event(EV_SYN, SYN_DROPPED, 0))
    assert state.wish().wheels is None


def test_stop_and_run_are_asked_for_once_and_run_not_while_holding() -> None:
    state = GamepadState(RANGES)
    state.take(Event(EV_KEY, pads.STOP, 1))
    state.take(Event(EV_KEY, pads.RUN, 1))
    assert state.wish() == Wish(stop=True, run=True)
    assert state.wish() == Wish()
    state.take(Event(EV_KEY, pads.HOLD, 1))
    state.take(Event(EV_KEY, pads.RUN, 1))
    assert not state.wish().run


def test_a_worn_stick_rests_in_its_dead_zone_and_a_turn_is_one_way() -> None:
    state = GamepadState(RANGES)
    state.take(Event(EV_KEY, pads.HOLD, 1))
    state.take(Event(EV_ABS, ABS_X, 3000))
    assert state.wish().wheels == (0, 0)
    state.take(Event(EV_ABS, ABS_X, 32767))
    left, right = state.wish().wheels or (0, 0)
    assert left > 0 > right
    assert mixed(1.0, 0.6) == (1.0, pytest.approx(0.25))


def test_a_tap_is_no_held_key() -> None:
    keys = KeyRepeats(0.4)
    keys.take("w", 0.0)
    assert keys.wheels(0.0) is None
    keys.take("w", FIRST_REPEAT_WITHIN_S)
    assert keys.wheels(0.8) == (0.4, 0.4)
    assert keys.wheels(0.8 + HELD_FOR_S + 0.01) is None
    keys.take("w", 0.8 + HELD_FOR_S + 0.01)  # late: it has to start over
    assert keys.wheels(1.01) is None
    keys.take("d", 1.02)
    assert keys.wheels(1.02) is None, "another key was held"
    keys.take("d", 1.05)
    assert keys.wheels(1.05) == pytest.approx((0.24, -0.24))


def test_keys_that_were_held_up_drive_nothing() -> None:
    """A line that hung brings them in one piece, or in several at once, long after the hand."""
    keys = KeyRepeats(0.4)
    for _ in range(10):
        keys.take("w", 1.0)
        assert keys.wheels(1.0) is None
    keys.take("w", 1.0 + HELD_UP_WITHIN_S / 2)
    assert keys.wheels(1.004) is None
    keys.take("w", 1.03)
    assert keys.wheels(1.03) is None, "one of a heap is no first repeat"
    keys.take("w", 1.06)
    assert keys.wheels(1.06) == (0.4, 0.4)


def test_several_of_one_key_in_one_read_are_none() -> None:
    ours, theirs = pty.openpty()
    with TerminalKeys(0.5, theirs) as keys:
        os.write(ours, b"wwwwwww")
        assert keys.read(1.0).wheels is None
    os.close(ours)


def test_arrows_are_keys() -> None:
    assert split_keys("\x1b[A\x1b[Dw q") == ["\x1b[A", "\x1b[D", "w", " ", "q"]


class Bench:
    """A session on a thread, as the command runs it."""

    def __init__(self, robot: FakeRobot, device: HandInput) -> None:
        self.said: list[str] = []
        self._robot = robot
        self._thread = threading.Thread(target=self._run, args=(device,))
        self._thread.start()

    def _run(self, device: HandInput) -> None:
        link = RobotLink(self._robot.address)
        with link, HandSession(link, self.said.append) as session:
            session.follow(device)

    def ended(self) -> bool:
        self._thread.join(10)
        return not self._thread.is_alive()


def kinds(robot: FakeRobot) -> list[str]:
    return [str(command.WhichOneof("action")) for command in robot.commands()]


def last(robot: FakeRobot) -> Command:
    return robot.commands()[-1]


def driving(robot: FakeRobot, count: int = 1) -> bool:
    return sum(command.drive.hold_ms > 1 for command in robot.commands()) >= count


def test_a_gamepad_drives_while_its_button_is_held(robot: FakeRobot, pad: PipedPad) -> None:
    bench = Bench(robot, Gamepad(pad, RANGES))
    pad.happens(EV_ABS, ABS_Y, UP)
    pad.press(pads.HOLD)
    began_s = time.monotonic()
    assert until(lambda: driving(robot, 6))
    assert 0.4 < time.monotonic() - began_s < 2.0, "repeated every 0.1 s"
    pad.press(pads.HOLD, 0)
    assert until(lambda: last(robot).drive.hold_ms == 1)
    assert "stop" not in kinds(robot)
    pad.unplug()
    assert bench.ended()
    assert kinds(robot)[-1] == "stop"


def test_unplugged_while_driving_it_stops(robot: FakeRobot, pad: PipedPad) -> None:
    bench = Bench(robot, Gamepad(pad, RANGES))
    pad.press(pads.HOLD)
    assert until(lambda: driving(robot))
    pad.unplug()
    assert bench.ended()
    assert kinds(robot)[-2:] == ["drive", "stop"]
    assert robot.commands()[-2].drive.hold_ms == 1


def test_somebody_elses_stop_takes_a_new_press(robot: FakeRobot, pad: PipedPad) -> None:
    bench = Bench(robot, Gamepad(pad, RANGES))
    pad.press(pads.HOLD)
    assert until(lambda: driving(robot))
    robot.stops += 1
    assert until(lambda: any("stopped by max" in words for words in bench.said))
    assert until(lambda: robot.names()[-1] == "status")  # who has read it may go on
    told = len(robot.commands())
    pad.press(pads.HOLD, 0)
    pad.press(pads.HOLD)
    assert until(lambda: len(robot.commands()) > told + 1)
    assert last(robot).stop_count == robot.stops
    pad.unplug()
    assert bench.ended()


def test_stop_and_the_way_back_to_the_policy(robot: FakeRobot, pad: PipedPad) -> None:
    bench = Bench(robot, Gamepad(pad, RANGES))
    pad.press(pads.HOLD)
    assert until(lambda: driving(robot))
    pad.press(pads.STOP)
    assert until(lambda: "stop" in kinds(robot))
    told = len(robot.commands())
    pad.press(pads.RUN)  # still held: nothing
    pad.press(pads.HOLD, 0)
    pad.press(pads.RUN)
    assert until(lambda: "run" in kinds(robot))
    assert not any(command.drive.hold_ms > 1 for command in robot.commands()[told:])
    assert until(lambda: "running" in bench.said)
    pad.unplug()
    assert bench.ended()


def test_a_mark_is_made_beside_the_hand_that_drives(
    robot: FakeRobot, pad: PipedPad, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = Bench(robot, Gamepad(pad, RANGES))
    pad.press(pads.HOLD)
    assert until(lambda: driving(robot))
    mark, asked = RemoteControl.mark, threading.Event()

    def slow(control: RemoteControl) -> None:
        asked.set()
        time.sleep(0.6)
        mark(control)

    monkeypatch.setattr(RemoteControl, "mark", slow)
    pad.press(pads.MARK)
    assert asked.wait(5)
    told = len(robot.commands())
    assert until(lambda: "mark" in kinds(robot))
    marked = kinds(robot).index("mark")
    assert kinds(robot)[told:marked].count("drive") > 3, "the hand was not held up"
    assert not any(command.drive.let_go for command in robot.commands())
    assert robot.commands()[marked].mark.back_ms == 3000
    assert until(lambda: any("3 s until now were wrong" in words for words in bench.said))
    pad.unplug()
    assert bench.ended()


@pytest.fixture
def terminal() -> Iterator[tuple[int, int]]:
    ours, theirs = pty.openpty()
    yield ours, theirs
    os.close(theirs)


def test_keys_of_a_terminal_drive_while_they_repeat(
    robot: FakeRobot, terminal: tuple[int, int]
) -> None:
    ours, theirs = terminal
    with TerminalKeys(0.5, theirs) as keys:
        bench = Bench(robot, keys)
        while not driving(robot, 3):
            os.write(ours, b"w")
            time.sleep(0.03)
        assert until(lambda: last(robot).drive.hold_ms == 1)
        os.write(ours, b"m")
        assert until(lambda: "mark" in kinds(robot))
        os.write(ours, b" ")
        assert until(lambda: kinds(robot)[-1] == "stop")
        os.write(ours, b"q")
        assert bench.ended()
    os.close(ours)


def test_without_a_terminal_or_evdev_it_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "evdev", None)
    with pytest.raises(ConfigurationError, match=r"needs evdev.*\[gamepad\]"):
        open_gamepad()
    reading, writing = os.pipe()
    with pytest.raises(ConfigurationError, match="needs a terminal"), TerminalKeys(0.4, reading):
        pass
    os.close(writing)
    os.close(reading)
    for wrong in ([], ["0.4"], ["0.4", "0.4", "--gamepad"], ["--keyboard", "--gamepad"]):
        result = CliRunner().invoke(workstation, ["drive", *wrong])
        assert "expected one of: LEFT RIGHT" in str(result.exception), wrong


def test_the_first_device_with_stick_and_buttons_is_the_gamepad(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    axis = SimpleNamespace(min=0, max=255)
    pad_can: dict[int, Any] = {EV_KEY: [BTN_SOUTH], EV_ABS: [(ABS_X, axis), (ABS_Y, axis)]}
    can = {"/dev/input/event0": {EV_KEY: [30]}, "/dev/input/event1": pad_can}

    def device(name: str) -> Any:
        if name not in can:
            raise OSError(13, "Permission denied")
        return SimpleNamespace(name=f"the {name[-1]}", capabilities=lambda: can[name])

    evdev: Any = SimpleNamespace(
        list_devices=lambda: ["/dev/input/event9", *can], InputDevice=device
    )
    monkeypatch.setitem(sys.modules, "evdev", evdev)
    assert open_gamepad()[1] == "the 1"
    with pytest.raises(ConfigurationError, match="no stick"):
        open_gamepad("/dev/input/event0")
    with pytest.raises(ConfigurationError, match="Permission denied"):
        open_gamepad("/dev/input/event9")
    del can["/dev/input/event1"]
    with pytest.raises(ConfigurationError, match="group 'input'"):
        open_gamepad()
