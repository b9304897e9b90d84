"""A gamepad, as the Linux kernel tells of it: hold the right shoulder button, drive with the stick.

`GamepadState` is pure; `open_gamepad` needs evdev, the extra `[gamepad]`.
"""

import importlib
import select
from collections.abc import Iterable
from typing import Any, Protocol

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.fleet.by_hand.hand import Wish, mixed

# Kernel's input-event-codes.h.
EV_SYN, EV_KEY, EV_ABS = 0, 1, 3
SYN_DROPPED = 3
ABS_X, ABS_Y = 0, 1
BTN_SOUTH, BTN_EAST, BTN_WEST, BTN_TR, BTN_START = 0x130, 0x131, 0x134, 0x137, 0x13B

HOLD, STOP, RUN, MARK = BTN_TR, BTN_EAST, BTN_START, BTN_WEST
DEAD_ZONE = 0.12
"""Of the stick's way: sticks of worn gamepads rest that far from the middle."""

TURN_SHARE = 0.6
"""Of the stick to the side: the robot turns on the spot in half a second at full speed."""


class InputEvent(Protocol):
    """As evdev has it."""

    @property
    def type(self) -> int:
        """EV_..."""
        ...

    @property
    def code(self) -> int:
        """Which button or axis."""
        ...

    @property
    def value(self) -> int:
        """1 pressed, 0 let go, 2 repeated; or where an axis is."""
        ...


class GamepadDevice(Protocol):
    """What is used of `evdev.InputDevice`."""

    def fileno(self) -> int:
        """To wait on."""
        ...

    def read(self) -> Iterable[InputEvent]:
        """What has happened; OSError once the device is gone."""
        ...


class GamepadState:
    """What is held, event by event."""

    def __init__(self, ranges: dict[int, tuple[int, int]]) -> None:
        """`ranges`: least and largest value of ABS_X and ABS_Y."""
        self._ranges = ranges
        self._stick = {ABS_X: 0.0, ABS_Y: 0.0}
        self._holds = False
        self._let_go = self._stop = self._run = self._mark = False

    def take(self, event: InputEvent) -> None:
        """One event."""
        if event.type == EV_SYN and event.code == SYN_DROPPED:
            self._holds = False  # events were lost: the button may have been let go
        elif event.type == EV_ABS and event.code in self._ranges:
            self._stick[event.code] = _share(event.value, self._ranges[event.code])
        elif event.type == EV_KEY:
            pressed = event.value == 1
            if event.code == HOLD:
                self._let_go |= not event.value
                self._holds = pressed or (self._holds and event.value == 2)
            self._stop |= pressed and event.code == STOP
            self._run |= pressed and event.code == RUN
            self._mark |= pressed and event.code == MARK

    def wish(self) -> Wish:
        """What is wanted now; STOP, run and a mark once."""
        let_go, stop, run, mark = self._let_go, self._stop, self._run, self._mark
        self._let_go = self._stop = self._run = self._mark = False
        # Up is negative. Who holds and drives has not meant the policy to take over.
        wheels = mixed(-self._stick[ABS_Y], TURN_SHARE * self._stick[ABS_X])
        # Let go and pressed again since the last look: that it was let go is heard, too.
        holds = self._holds and not let_go
        return Wish(wheels if holds else None, stop, run and not self._holds, mark=mark)


class Gamepad:
    """An opened one: a `HandInput`."""

    def __init__(self, device: GamepadDevice, ranges: dict[int, tuple[int, int]]) -> None:
        self._device = device
        self._state = GamepadState(ranges)

    def read(self, wait_s: float) -> Wish:
        """As `HandInput`; the end once it is unplugged."""
        try:
            ready, _, _ = select.select([self._device], [], [], wait_s)
            if ready:
                for event in self._device.read():
                    self._state.take(event)
        except OSError:
            return Wish(end=True)
        return self._state.wish()


def open_gamepad(path: str = "") -> tuple[Gamepad, str]:
    """The gamepad at /dev/input/eventN, or the first one; and its name.

    Raises:
        ConfigurationError: evdev is not installed, or there is none that may be read.

    """
    try:
        evdev: Any = importlib.import_module("evdev")
    except ModuleNotFoundError:
        raise ConfigurationError(
            "--gamepad needs evdev: pip install -c constraints.txt -e '.[gamepad]' in the checkout"
        ) from None
    for name in [path] if path else evdev.list_devices():
        try:
            device = evdev.InputDevice(name)
            can = device.capabilities()
        except OSError as error:
            if path:
                raise ConfigurationError(f"can't read {path}: {error.strerror}") from None
            continue
        axes = {code: (info.min, info.max) for code, info in can.get(EV_ABS, [])}
        if BTN_SOUTH in can.get(EV_KEY, []) and {ABS_X, ABS_Y} <= axes.keys():
            return Gamepad(device, {axis: axes[axis] for axis in (ABS_X, ABS_Y)}), device.name
        if path:
            raise ConfigurationError(f"{path} is {device.name}, which has no stick and buttons")
    raise ConfigurationError(
        "no gamepad at /dev/input that you may read: is it plugged in, and are you in the group "
        "'input'?"
    )


def _share(value: int, limits: tuple[int, int]) -> float:
    """Where a stick is, in [-1, 1], 0 around its middle."""
    low, high = limits
    if high <= low:
        return 0.0
    share = max(-1.0, min(1.0, 2 * (value - low) / (high - low) - 1))
    return 0.0 if abs(share) < DEAD_ZONE else share
