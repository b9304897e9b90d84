"""A board with a real firmware that is no faster and no slower than whoever simulates its world."""

import subprocess
from pathlib import Path
from typing import Self

from mbot_protocol.drive.mcore import STOP, Joystick, Reply, ReplyParser
from mbot_protocol.errors import MbotError
from mbot_workstation.virtual.emulated.board_simulator import simulator_program
from mbot_workstation.virtual.emulated.motor_pins import MotorPins, felt_lines


class LockstepBoard:
    """A firmware on simavr, run from moment to moment; use it in a `with`.

    Attributes:
        motors: what the pins make of them now.
        trace: since when they did what: microseconds, speeds.

    """

    def __init__(self, firmware: Path, program: Path | None = None) -> None:
        self._command = [str(program or simulator_program()), str(firmware)]
        self._parser = ReplyParser()
        self._now_us = 0
        self.motors: Joystick = STOP
        self.trace: list[tuple[int, Joystick]] = []

    def __enter__(self) -> Self:
        self._child = subprocess.Popen(
            self._command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        return self

    def __exit__(self, *_: object) -> None:
        self._child.kill()
        self._child.wait()

    def say(self, data: bytes) -> None:
        """Put bytes on its line, now."""
        self._write(f"rx {data.hex()}")

    def feel(self, floor: tuple[bool, bool], echo_m: float) -> None:
        """What its sensors tell from now on: both infrared pairs, and the echo; 0: none."""
        for line in felt_lines(floor, echo_m):
            self._write(line)

    def run(self, duration_s: float) -> list[Reply]:
        """Let time pass; what the board has said meanwhile.

        Raises:
            MbotError: the emulator has ended.

        """
        self._now_us += round(duration_s * 1e6)
        self._write("sync")
        assert self._child.stdin is not None
        assert self._child.stdout is not None
        self._child.stdin.flush()
        said: list[Reply] = []
        for line in self._child.stdout:
            at, what, *values = line.split()
            if what == "sync":
                return said
            if what == "pins":
                self.motors = MotorPins(int(at), *map(int, values)).joystick
                self.trace.append((int(at), self.motors))
            else:
                said += self._parser.feed(bytes.fromhex(values[0]))
        raise MbotError("the emulated board has ended")

    def _write(self, line: str) -> None:
        assert self._child.stdin is not None
        self._child.stdin.write(f"{self._now_us} {line}\n")
