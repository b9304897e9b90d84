"""The compiled firmware on a simulated ATmega328P: what goes in, what its pins and line do."""

import bisect
import subprocess
from dataclasses import dataclass, field
from pathlib import Path

from mbot_workstation.virtual.emulated.board_process import BoardProcess
from mbot_workstation.virtual.emulated.motor_pins import MotorPins

from ..until import until

BYTE_US = 94
"""How far apart the simulator puts the bytes of one `send`; a real line takes 87 us each."""


@dataclass(frozen=True, slots=True)
class Pins(MotorPins):
    """The registers that decide what the motors do, and since when."""

    @property
    def speeds(self) -> tuple[int, int]:
        """The speeds of M1 and M2 that these pins make."""
        return self.joystick.m1, self.joystick.m2


@dataclass
class Trace:
    """Everything that happened, in the order of simulated time."""

    pins: list[Pins] = field(default_factory=list)
    sent: list[tuple[int, int]] = field(default_factory=list)
    received: list[tuple[int, int]] = field(default_factory=list)

    def add(self, line: str) -> None:
        at, what, *values = line.split()
        if what == "pins":
            self.pins.append(Pins(int(at), *map(int, values)))
        else:
            where = self.sent if what == "tx" else self.received
            where.append((int(at), int(values[0], 16)))

    def speeds_at(self, at_ms: float) -> tuple[int, int]:
        index = bisect.bisect_right(self.pins, at_ms * 1000, key=lambda pins: pins.at_us)
        return self.pins[index - 1].speeds

    def speeds_since(self, at_ms: float = 0) -> set[tuple[int, int]]:
        """All speeds that were in force at this time or later."""
        later = {pins.speeds for pins in self.pins if pins.at_us >= at_ms * 1000}
        return later | {self.speeds_at(at_ms)}

    def replies(self, from_ms: float = 0, to_ms: float = 1e9) -> bytes:
        return bytes(byte for at, byte in self.sent if from_ms * 1000 <= at < to_ms * 1000)

    def stopped_us(self) -> int:
        """Since when the motors have been off; they must be."""
        assert self.pins[-1].speeds == (0, 0)
        moving = [index for index, pins in enumerate(self.pins) if pins.speeds != (0, 0)]
        return self.pins[moving[-1] + 1].at_us


@dataclass(frozen=True)
class Simulator:
    """The harness and the firmware it runs."""

    program: Path
    firmware: Path

    def run(self, *events: tuple[float, str, bytes], end_ms: float) -> Trace:
        """Do `(ms, verb, bytes)` in the order of time; the same events give the same trace."""
        lines = [f"{round(ms * 1000)} {verb} {data.hex()}" for ms, verb, data in events]
        lines.append(f"{round(end_ms * 1000)} end")
        done = subprocess.run(
            [self.program, self.firmware],
            input="\n".join(lines),
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        trace = Trace()
        for line in done.stdout.splitlines():
            trace.add(line)
        return trace


class LiveBoard(BoardProcess):
    """The firmware in real time behind a pseudo-terminal; use it in a `with`.

    Attributes:
        trace: what has happened so far.

    """

    def __init__(self, simulator: Simulator) -> None:
        self.trace = Trace()
        super().__init__(simulator.firmware, self.trace.add, program=simulator.program)

    @property
    def speeds(self) -> tuple[int, int]:
        return self.trace.pins[-1].speeds if self.trace.pins else (0, 0)

    def wait_for(self, *speeds: int, timeout_s: float = 15.0) -> bool:
        return until(lambda: self.speeds == speeds, timeout_s)


def emulators_of(pid: int) -> set[int]:
    """The running emulators that this process has started."""
    lists = Path(f"/proc/{pid}/task").glob("*/children")
    children = {int(child) for told in lists for child in told.read_text().split()}
    return {child for child in children if is_emulator(child)}


def is_emulator(pid: int) -> bool:
    try:
        return "board_simulator" in Path(f"/proc/{pid}/cmdline").read_text()
    except OSError:
        return False
