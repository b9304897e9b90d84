"""The lines of a `serial-line` board: what is said, what comes back. No I/O.

A drive command is always nine characters long, so that no part of one is another; what was obeyed
comes back as it is, so that what was garbled on its way is not taken for what was meant.
"""

import re

from mbot_agent.board.board_session import Firmware
from mbot_protocol.drive.actions import LEVELS
from mbot_protocol.drive.wheel_command import Duties

ASK_VERSION, ARM, STOP_LINE = "V", "A", "S"
BOOT = "boot "
"""How a line begins that comes unasked after a reset."""

VERSION = 1
"""Of these lines."""

LONGEST_DEADMAN_MS = 1000
"""A time-out above that is no dead man's switch."""

LONGEST_LINE = 80

_NAME = re.compile(r"serial-line (\d{1,3}) (\d{1,6})ms")


def drive_line(motors: Duties) -> str:
    """Both motors in 255ths, such as D-120+080."""
    return f"D{round(motors.left * LEVELS):+04d}{round(motors.right * LEVELS):+04d}"


def firmware(line: str) -> Firmware | None:
    """What a board is that has answered ASK_VERSION by this line; None if it is no such answer."""
    if (found := _NAME.fullmatch(line)) is None:
        return None
    version, timeout_ms = map(int, found.groups())
    mistaken = "" if version == VERSION else f"{line}: expected version {VERSION} of its lines"
    return Firmware(
        line,
        has_deadman=0 < timeout_ms <= LONGEST_DEADMAN_MS,
        may_latch=True,
        mistaken=f"{mistaken}; load deploy/serial-line/serial-line.ino onto it" if mistaken else "",
    )


class LineReader:
    """Makes lines of what comes in pieces; those that are too long are none."""

    def __init__(self) -> None:
        self._begun = b""

    def feed(self, data: bytes) -> list[str]:
        """The lines that these bytes complete, without their ends."""
        *whole, self._begun = (self._begun + data).split(b"\n")
        self._begun = self._begun[: LONGEST_LINE + 1]  # enough to know that it is too long
        lines = (line.rstrip(b"\r") for line in whole if len(line) <= LONGEST_LINE)
        return [line.decode("ascii", "replace") for line in lines if line]
