"""What every kind of board must do: one open connection, as the motor thread uses it.

The thread holds deadline, guard and arming; a kind turns duties into its frames and tells what has
come of them. `board_kinds.KINDS` names the kinds.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, Self

from mbot_agent.configuration import SensesSettings
from mbot_protocol.drive.actions import WheelMaps
from mbot_protocol.drive.senses import Senses
from mbot_protocol.drive.wheel_command import Duties
from mbot_protocol.errors import UnreachableError


class BoardLostError(UnreachableError):
    """The port broke, or the board stopped answering, in mid-session."""


class BoardResetError(BoardLostError):
    """The board has announced that it has just been reset; its motors are off."""


class UnacknowledgedError(BoardLostError):
    """The board did not acknowledge one frame in time; it may acknowledge the next."""


@dataclass(frozen=True, slots=True)
class Firmware:
    """What answers on a board.

    Attributes:
        version: its name of itself; empty: nothing has answered.
        has_deadman: whether it stops the motors by itself when commands cease.
        may_latch: whether it refuses to drive after a reset or a silence until it is armed.
        mistaken: why this is no board to drive with, and what to do; empty: it is one.

    """

    version: str = ""
    has_deadman: bool = False
    may_latch: bool = False
    mistaken: str = ""


class BoardSession(Protocol):
    """An exclusive connection. As a context manager it stops the motors at its end.

    Attributes:
        path: the port, for people.
        firmware: what has answered the handshake.
        senses: what it told of them last, another object each time; None: nothing.

    """

    path: str
    firmware: Firmware
    senses: Senses | None

    def __enter__(self) -> Self: ...

    def __exit__(self, kind: object, error: object, trace: object) -> None: ...

    def handshake(self, giving_up: Callable[[], bool]) -> bool:
        """Stop whatever the board was doing, then wait until it has said what it is.

        Args:
            giving_up: asked between attempts; true ends the handshake early.

        Returns:
            Whether the board answered; false only after giving up.

        Raises:
            BoardLostError: no answer in time.

        """
        ...

    def send(self, motors: Duties) -> tuple[int, int]:
        """Write one command and wait for its acknowledgement.

        Args:
            motors: as the motors have it (`WheelMaps.at_motors`); positive as a motor runs.

        Returns:
            Monotonic times in ns: when the write began, when the acknowledgement was read.

        Raises:
            UnacknowledgedError: no acknowledgement came in time.
            BoardLostError: the port broke.
            BoardResetError: the board has been reset.

        """
        ...

    def stop(self) -> None:
        """Stop the motors for certain, whatever the board was in the middle of.

        Raises:
            BoardLostError: it was not acknowledged however often it was said, or the port broke.
            BoardResetError: the board has been reset; its motors are off.

        """
        ...

    def arm(self) -> None:
        """Let a board that has latched drive again; nothing is sent to firmware that never does.

        Raises:
            BoardLostError, BoardResetError: as `send`.

        """
        ...

    def watch(self, settings: SensesSettings, wheels: WheelMaps) -> bool:
        """Have the board tell its senses from now on, and hold the robot back as configured.

        Returns:
            Whether it can; false as well if nothing is asked for.

        Raises:
            BoardLostError, BoardResetError: as `send`.

        """
        ...

    def wait(self, timeout_s: float) -> None:
        """Sleep until the time-out, a wake-up or news from the board; take in what it says.

        Raises:
            BoardLostError: the port broke.
            BoardResetError: the board has been reset.

        """
        ...
