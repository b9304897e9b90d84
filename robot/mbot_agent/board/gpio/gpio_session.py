"""Two motors on the computer's pins: duties as PWM on the driver's forward and backward inputs.

gpiozero and what it stands on (lgpio) come from apt, like picamera2. Nothing here can outlive its
process: a killed one leaves the pins as they are, until `mbot-agent stop-motors` has run.
"""

import importlib
import select
import time
from collections.abc import Callable, Generator
from contextlib import ExitStack, contextmanager
from importlib.metadata import version
from typing import Any, Self

from mbot_agent.board.board_session import BoardLostError, Firmware
from mbot_agent.configuration import BoardSettings, GpioSettings, SensesSettings
from mbot_protocol.drive.actions import WheelMaps
from mbot_protocol.drive.senses import Senses
from mbot_protocol.drive.wheel_command import STOP, Duties
from mbot_protocol.errors import UnreachableError


class GpioSession:
    """A `BoardSession`. What is sent is done when `send` returns: nothing acknowledges it."""

    senses: Senses | None = None

    def __init__(self, gpio: GpioSettings, wake_fd: int | None) -> None:
        """Take the pins, low; enable the driver.

        Raises:
            UnreachableError: no gpiozero, no such pins, or another program has them.

        """
        self.path = f"GPIO {', '.join(map(str, gpio.pins))}"
        self.firmware = Firmware()
        self._wake_fds = [] if wake_fd is None else [wake_fd]
        library = _gpiozero()
        with ExitStack() as opened, _explained(self.path, UnreachableError):
            self._left = _held(opened, library.Motor(*gpio.left))
            self._right = _held(opened, library.Motor(*gpio.right))
            for pin in gpio.enable:
                _held(opened, library.DigitalOutputDevice(pin, initial_value=True))
            self._pins = opened.pop_all()

    @classmethod
    def open(cls, board: BoardSettings, wake_fd: int | None) -> "GpioSession":
        """Take the pins as configured; raises UnreachableError."""
        return cls(board.gpio, wake_fd)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        with self._pins:
            self.stop()

    def handshake(self, giving_up: Callable[[], bool]) -> bool:
        """Stop the motors; there is nobody to ask."""
        self.stop()
        self.firmware = Firmware(f"gpiozero {version('gpiozero')}")
        return True

    def send(self, motors: Duties) -> tuple[int, int]:
        """Set both motors' PWM."""
        began_ns = time.monotonic_ns()
        with _explained(self.path, BoardLostError):
            self._left.value, self._right.value = motors.left, motors.right
        return began_ns, time.monotonic_ns()

    def stop(self) -> None:
        """Set all inputs of the driver low."""
        self.send(STOP)

    def arm(self) -> None:
        """Nothing: it never latches."""

    def watch(self, settings: SensesSettings, wheels: WheelMaps) -> bool:
        """Nothing: no sensor is read at pins."""
        return False

    def wait(self, timeout_s: float) -> None:
        """Sleep until the time-out or a wake-up; pins tell no news."""
        select.select(self._wake_fds, [], [], max(0.0, timeout_s))


def _gpiozero() -> Any:
    try:
        return importlib.import_module("gpiozero")
    except ImportError as error:
        raise UnreachableError(
            f"gpiozero cannot be imported ({error}): "
            "sudo apt install python3-gpiozero python3-lgpio"
        ) from None


def _held(opened: ExitStack, device: Any) -> Any:
    opened.callback(device.close)
    return device


@contextmanager
def _explained(path: str, kind: type[UnreachableError]) -> Generator[None]:
    """Errors of gpiozero and of the several libraries below it have no base in common."""
    try:
        yield
    except UnreachableError:
        raise
    except Exception as error:
        raise kind(f"{path}: {type(error).__name__}: {error}; see docs/other-robots.md") from None
