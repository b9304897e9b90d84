"""The real daemon with a second kind of board: lines of text, acknowledged by "ok".

`V` asks for the version, `D -0.25 0.5` drives the motors by these duties, `S` stops them; "boot"
comes unasked after a reset. All that a kind of board takes is this file and its line in the table.
"""

import time
from collections.abc import Callable
from typing import Self

from mbot_agent import main
from mbot_agent.board import board_kinds
from mbot_agent.board.board_session import (
    BoardLostError,
    BoardResetError,
    Firmware,
    UnacknowledgedError,
)
from mbot_agent.board.serial_line import SerialLine
from mbot_agent.configuration import BoardSettings, SensesSettings
from mbot_protocol.drive.actions import WheelMaps
from mbot_protocol.drive.senses import Senses
from mbot_protocol.drive.wheel_command import Duties


class LineSession:
    senses: Senses | None = None

    def __init__(self, board: BoardSettings, wake_fd: int | None) -> None:
        self.path, self.firmware, self._heard = board.port, Firmware(), b""
        self._line = SerialLine(board.port, board.baud_rate, wake_fd)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        try:
            if not isinstance(error, BoardLostError):
                self.stop()
        except BoardLostError:
            pass
        finally:
            self._line.close()

    def handshake(self, giving_up: Callable[[], bool]) -> bool:
        end_s = time.monotonic() + 2
        while time.monotonic() < end_s and not giving_up():
            self._line.write(b"\nV\n")
            for line in self._lines(0.2):
                if line.startswith("line-board "):
                    self.firmware = Firmware(line, has_deadman=True)
                    self.stop()
                    return True
        if giving_up():
            return False
        raise BoardLostError(f"nothing on {self.path} speaks in lines")

    def send(self, motors: Duties) -> tuple[int, int]:
        return self._exchange(f"D {motors.left:.4f} {motors.right:.4f}")

    def stop(self) -> None:
        for _ in range(2):  # the first one ends a line that was torn
            self._exchange("\nS")

    def arm(self) -> None:
        pass  # it never latches

    def watch(self, settings: SensesSettings, wheels: WheelMaps) -> bool:
        return False  # it feels nothing

    def wait(self, timeout_s: float) -> None:
        self._lines(timeout_s, wakeable=True)

    def _exchange(self, line: str) -> tuple[int, int]:
        written_ns = time.monotonic_ns()
        self._line.write(f"{line}\n".encode())
        while (left_s := written_ns / 1e9 + 0.05 - time.monotonic()) > 0:
            if "ok" in self._lines(left_s):
                return written_ns, time.monotonic_ns()
        raise UnacknowledgedError(f"{self.path} does not acknowledge")

    def _lines(self, timeout_s: float, *, wakeable: bool = False) -> list[str]:
        self._heard += self._line.read(timeout_s, wakeable=wakeable)
        *whole, self._heard = self._heard.split(b"\n")
        if b"boot" in whole:
            raise BoardResetError(f"the board on {self.path} has been reset")
        return [line.decode(errors="replace") for line in whole]


if __name__ == "__main__":
    board_kinds.KINDS["lines"] = LineSession
    main.main()
