"""One open connection to a board that speaks in lines: handshake, commands, their echoes.

Not thread-safe: the motor thread alone uses it.
"""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Self

from mbot_agent.board.board_session import (
    BoardLostError,
    BoardResetError,
    Firmware,
    UnacknowledgedError,
)
from mbot_agent.board.lines.line_protocol import (
    ARM,
    ASK_VERSION,
    BOOT,
    STOP_LINE,
    LineReader,
    drive_line,
    firmware,
)
from mbot_agent.board.serial_line import SerialLine
from mbot_agent.configuration import BoardSettings, SensesSettings
from mbot_protocol.drive.actions import WheelMaps
from mbot_protocol.drive.senses import Senses
from mbot_protocol.drive.wheel_command import Duties
from mbot_protocol.errors import UnreachableError

HANDSHAKE_TIMEOUT_S = 6.0
"""Opening the port resets most Arduinos; their boot loaders take up to 2 s, doubled and more."""

ASK_INTERVAL_S = 0.2
"""What is sent during the boot is lost, so the question is repeated."""

ECHO_TIMEOUT_S = 0.05
"""A line and its echo take 2 ms at 115200 baud; some USB chips hold bytes back for 16 ms."""

STOP_ATTEMPTS = 4


class LineSession:
    """A `BoardSession`."""

    senses: Senses | None = None

    def __init__(self, line: SerialLine) -> None:
        """Take over an open line."""
        self.path = line.path
        self.firmware = Firmware()
        self._line = line
        self._reader = LineReader()

    @classmethod
    def open(cls, board: BoardSettings, wake_fd: int | None) -> "LineSession":
        """Open the port, which resets most boards. Nothing has been sent yet.

        Raises:
            UnreachableError: no port is named, or it cannot be opened.

        """
        if board.port == "auto":
            there = ", ".join(map(str, Path("/dev/serial/by-id").glob("*"))) or "nothing"
            raise UnreachableError(
                f"a serial-line board has no name to be found by: set board.port; there is {there}"
            )
        return cls(SerialLine(board.port, board.baud_rate, wake_fd))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        try:
            if not isinstance(error, BoardLostError):
                self.stop()
        except BoardLostError:
            pass  # its own time-out stops it, if it has one
        finally:
            self._line.close()

    def handshake(self, giving_up: Callable[[], bool]) -> bool:
        """Stop the motors and ask for the version until it comes, 6 s."""
        deadline = time.monotonic() + HANDSHAKE_TIMEOUT_S
        while time.monotonic() < deadline and not giving_up():
            self._say(f"\n{STOP_LINE}\n{ASK_VERSION}")
            again = time.monotonic() + ASK_INTERVAL_S
            while (left_s := again - time.monotonic()) > 0:
                for line in self._reader.feed(self._line.read(left_s)):
                    if (found := firmware(line)) is not None:
                        self.firmware = found
                        self.stop()
                        return True
        if giving_up():
            return False
        raise BoardLostError(
            f"no serial-line board answers on {self.path} at {self._line.baud_rate} baud in "
            f"{HANDSHAKE_TIMEOUT_S:.0f} s: wrong board.port or board.baud_rate, or its sketch is "
            "missing (deploy/serial-line)"
        )

    def send(self, motors: Duties) -> tuple[int, int]:
        """Write one line and wait for its echo, 50 ms."""
        return self._exchange(drive_line(motors))

    def stop(self) -> None:
        """Stop the motors, until it is echoed. An empty line ends one that was torn."""
        for _ in range(STOP_ATTEMPTS):
            try:
                self._exchange(STOP_LINE, before="\n")
            except UnacknowledgedError:
                continue
            return
        raise BoardLostError(f"{self.path} does not acknowledge the stop command")

    def arm(self) -> None:
        """Let it drive; every such board knows the word."""
        self._exchange(ARM)

    def watch(self, settings: SensesSettings, wheels: WheelMaps) -> bool:
        """Nothing: these lines tell of no sensors."""
        return False

    def wait(self, timeout_s: float) -> None:
        """Sleep until the time-out, a wake-up or news from the board; take in what it says."""
        self._lines(timeout_s, wakeable=True)

    def _exchange(self, line: str, before: str = "") -> tuple[int, int]:
        self._lines(0.0)  # an echo that comes late is not this one's
        written_ns = time.monotonic_ns()
        self._say(before + line)
        deadline = time.monotonic() + ECHO_TIMEOUT_S
        while (left_s := deadline - time.monotonic()) > 0:
            if line in self._lines(left_s):
                return written_ns, time.monotonic_ns()
        raise UnacknowledgedError(f"{self.path} does not acknowledge commands")

    def _say(self, line: str) -> None:
        self._line.write(f"{line}\n".encode("ascii"))

    def _lines(self, timeout_s: float, *, wakeable: bool = False) -> list[str]:
        lines = self._reader.feed(self._line.read(timeout_s, wakeable=wakeable))
        if any(line.startswith(BOOT) for line in lines):
            raise BoardResetError(f"the board on {self.path} has been reset")
        return lines
