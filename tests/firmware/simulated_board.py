"""The compiled firmware on a simulated ATmega328P: what goes in, what its pins and line do."""

import bisect
import subprocess
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Self

BYTE_US = 94
"""How far apart the simulator puts the bytes of one `send`; a real line takes 87 us each."""

M1_DIR, M1_PWM, M2_DIR, M2_PWM = 1 << 7, 1 << 6, 1 << 4, 1 << 5
CONNECTED = {M1_PWM: 1 << 7, M2_PWM: 1 << 5}  # COM0A1, COM0B1: the timer has the pin
FAST_PWM = 3


@dataclass(frozen=True, slots=True)
class Pins:
    """The registers that decide what the motors do, and since when."""

    at_us: int
    ocr0a: int
    ocr0b: int
    tccr0a: int
    portd: int
    ddrd: int

    @property
    def speeds(self) -> tuple[int, int]:
        """The speeds of M1 and M2 that these pins make: duty (|v| + 1) / 256, sign from DIR."""
        return self._speed(self.ocr0a, M1_PWM, M1_DIR), self._speed(self.ocr0b, M2_PWM, M2_DIR)

    def _speed(self, compare: int, pwm: int, direction: int) -> int:
        if not self.ddrd & pwm:
            return 0  # an input: the motor driver's own resistor pulls it low
        if not self.tccr0a & CONNECTED[pwm]:
            assert not self.portd & pwm, "the pin is high without the timer: full speed"
            return 0
        assert self.tccr0a & FAST_PWM == FAST_PWM
        return compare if self.portd & direction else -compare


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


class LiveBoard:
    """The firmware in real time behind a pseudo-terminal; use it in a `with`.

    Attributes:
        path: the port to open.
        trace: what has happened so far.

    """

    def __init__(self, simulator: Simulator) -> None:
        self._child = subprocess.Popen(
            [simulator.program, simulator.firmware, "--pty"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self._child.stdout is not None
        self.path = self._child.stdout.readline().strip()
        self.trace = Trace()
        self._reader = threading.Thread(target=self._read, daemon=True)

    def __enter__(self) -> Self:
        self._reader.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        assert self._child.stdin is not None
        self._child.stdin.close()
        self._child.wait(10)
        self._reader.join()

    @property
    def speeds(self) -> tuple[int, int]:
        return self.trace.pins[-1].speeds if self.trace.pins else (0, 0)

    def wait_for(self, *speeds: int, timeout_s: float = 15.0) -> bool:
        return until(lambda: self.speeds == speeds, timeout_s)

    def _read(self) -> None:
        assert self._child.stdout is not None
        for line in self._child.stdout:
            self.trace.add(line)


def until(condition: Callable[[], bool], timeout_s: float = 15.0) -> bool:
    deadline = time.monotonic() + timeout_s
    while time.monotonic() < deadline:
        if condition():
            return True
        time.sleep(0.002)
    return False
