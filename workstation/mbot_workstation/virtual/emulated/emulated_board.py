"""An mCore board whose firmware is the real one: same port, same states as the modelled board."""

import time
from collections import deque
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Self

from mbot_protocol.drive.mcore import STOP, Acknowledgement, ReplyParser
from mbot_protocol.errors import MbotError
from mbot_workstation.virtual.emulated.board_process import BoardProcess
from mbot_workstation.virtual.emulated.motor_pins import MotorPins, felt_lines
from mbot_workstation.virtual.mcore_board import TRACE_STATES, BoardState
from mbot_workstation.virtual.port_link import PortLink

TOLD_WITHIN_MS = 50.0
"""A stop that comes later than this after the last byte is the board's own."""


class EmulatedBoard:
    """A firmware on an emulated ATmega328P behind a pty; use it in a `with`.

    Its motors' speeds are read from the timer's and the port's registers, so what drives is the
    firmware's own PWM and not what it was told.

    Attributes:
        trace: the states the motors have been in, oldest first; the last ten thousand.
        heard_us, changed_us: the board's own time, which stands still when this machine is too
            busy, of the last byte from the host and of the motors' last change.

    """

    def __init__(self, firmware: Path, link: Path | None = None, *, boot_s: float = 0.0) -> None:
        """Prepare it.

        Args:
            firmware: ELF or Intel HEX file.
            link: where to put a symbolic link to the port.
            boot_s: how long it is deaf after its port was opened; 0: opening is not a reset.

        Raises:
            ConfigurationError: the emulator can't be compiled.

        """
        self._process = BoardProcess(firmware, self._take, boot_s=boot_s, ended=self._note_end)
        self._link = link
        self._resources = ExitStack()
        self._replies = ReplyParser()
        self._commands = 0
        self._state = BoardState(STOP, time.monotonic(), 0)
        self._failure: MbotError | None = None
        self._felt: list[str] = []
        self.trace = deque([self._state], maxlen=TRACE_STATES)
        self.heard_us = 0
        self.changed_us = 0

    @property
    def path(self) -> Path:
        """The port to open: the link where one was given, else the pty's own name."""
        return self._link or Path(self._process.port)

    @property
    def state(self) -> BoardState:
        """What the motors do now; `commands` are those the firmware has acknowledged.

        Raises:
            MbotError: the emulator has ended by itself, or its motors can't be understood.

        """
        if self._failure is not None:
            raise self._failure
        return self._state

    def feel(self, floor: tuple[bool, bool], echo_m: float) -> None:
        """What the line follower at port 2 sees from now on, and how far away the thing is that
        answers the ultrasonic sensor; 0: none.
        """
        told = felt_lines(floor, echo_m)
        new = [line for line in told if line not in self._felt]
        if new:
            self._felt = told
            self._process.tell(*new)

    def __enter__(self) -> Self:
        with ExitStack() as resources:
            resources.enter_context(self._process)
            if self._link is not None:
                resources.callback(PortLink(self._link, self._process.port).remove)
            self._resources = resources.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._resources.close()

    def _note_end(self, failure: MbotError) -> None:
        self._failure = failure

    def _take(self, line: str) -> None:
        """A line of the emulator: TIME rx|tx HEX, or TIME pins and five registers."""
        at, what, *values = line.split()
        if what == "pins":
            self._note(MotorPins(int(at), *map(int, values)))
        elif what == "rx":
            self.heard_us = int(at)
        else:
            for reply in self._replies.feed(bytes.fromhex(values[0])):
                if isinstance(reply, Acknowledgement):
                    self._commands += 1
                    self._state = replace(self._state, commands=self._commands)

    def _note(self, pins: MotorPins) -> None:
        motors = pins.joystick
        if motors != self._state.motors:
            self.changed_us = pins.at_us
            silent_ms = (pins.at_us - self.heard_us) / 1000
            by_itself = motors == STOP and silent_ms > TOLD_WITHIN_MS
            self._state = BoardState(
                motors, time.monotonic(), self._commands, silent_ms if by_itself else 0.0
            )
            self.trace.append(self._state)
