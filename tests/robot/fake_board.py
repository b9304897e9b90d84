"""A stand-in for the mCore board on a pty, with the faults a real one can have."""

import fcntl
import os
import select
import struct
import threading
import time
import tty
from pathlib import Path
from typing import Self

from mbot_protocol.drive.mcore import END, HEADER, tells_senses, wants_arming

_UNLOCK, _NUMBER = 0x40045431, 0x80045430
"""TIOCSPTLCK and TIOCGPTN, which Python's termios does not have."""

WIRE_S_PER_BYTE = 10 / 115_200
"""Eight bits, a start and a stop; a pty has no wire, and a stop burst takes a real one 5.4 ms."""

STOP_FRAME = bytes.fromhex("ff5507000205 0000 0000".replace(" ", ""))


class FakeBoard:
    """Obeys and acknowledges stock frames; keeps every joystick command with its time.

    Attributes:
        path: the port to open.
        commands: (monotonic seconds, m1, m2) of every joystick frame obeyed.
        received: every byte.
        mute: when true, nothing is answered.
        acknowledge: when false, commands are obeyed and nothing is said.
        unheard: so many of the next commands get lost on their way.
        unheard_drives: the same, of those that are no stops.
        latched: refuses to drive until ARM has come, as our firmware does after a reset.
        behind_a_reply: what it says in one piece with its next acknowledgement.
        felt: what it says of its sensors as soon as it is asked to tell.
        version: what it calls itself.

    """

    def __init__(
        self, version: str = "06.01.107", *, devpts: Path = Path("/dev/pts"), mode: int = 0o600
    ) -> None:
        """Plug it in.

        Args:
            version: what it calls itself.
            devpts: where ports are; a container has its own.
            mode: who may open the port.

        """
        self.version = version
        self.mute = False
        self.acknowledge = True
        self.unheard = self.unheard_drives = 0
        self.latched = wants_arming(version)
        self.behind_a_reply = self.felt = b""
        self.commands: list[tuple[float, int, int]] = []
        self.received = bytearray()
        self._master, self._slave, number = _openpty(devpts)
        tty.setraw(self._slave)
        os.fchmod(self._slave, mode)
        self.path = f"/dev/pts/{number}"
        self._closing = False
        self._buffer = bytearray()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.unplug()

    @property
    def speeds(self) -> tuple[int, int]:
        """What the motors do now."""
        return self.commands[-1][1:] if self.commands else (0, 0)

    @property
    def moved(self) -> bool:
        """Whether any command ever turned a wheel."""
        return any((m1, m2) != (0, 0) for _, m1, m2 in self.commands)

    def unplug(self) -> None:
        """Make the port vanish."""
        if not self._closing:
            self._closing = True
            self._thread.join(timeout=2)
            os.close(self._master)
            os.close(self._slave)

    def say(self, data: bytes) -> None:
        """Send something unasked."""
        os.write(self._master, data)

    def reset(self) -> None:
        """What a brown-out does: motors off, then the banner."""
        self.commands.append((time.monotonic(), 0, 0))
        self.latched = wants_arming(self.version)
        self._buffer.clear()
        self.say(f"Version: {self.version}\r\n".encode())

    def feel(self, distance_mm: int, told: int, supply_20_mv: int = 250) -> None:
        """Tell of its sensors, as `feeling` has it."""
        self.say(self.feeling(distance_mm, told, supply_20_mv))

    @staticmethod
    def feeling(distance_mm: int, told: int, supply_20_mv: int = 250) -> bytes:
        """What the sensors tell: a reading, the floor's and reflexes' bits, the supply."""
        reading = distance_mm.to_bytes(2, "little") + bytes((told, supply_20_mv))
        return HEADER + b"\x72\x06" + reading + END

    def wait_for(self, m1: int, m2: int, timeout_s: float = 3.0) -> bool:
        """Whether the motors come to these speeds in time."""
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline:
            if self.commands and self.speeds == (m1, m2):
                return True
            time.sleep(0.002)
        return False

    def _run(self) -> None:
        while not self._closing:
            ready, _, _ = select.select([self._master], [], [], 0.02)
            if not ready:
                continue
            data = os.read(self._master, 4096)
            time.sleep(len(data) * WIRE_S_PER_BYTE)
            self.received += data
            self._buffer += data
            while (reply := self._take()) is not None:
                if reply and not self.mute:
                    time.sleep(len(reply) * WIRE_S_PER_BYTE)
                    os.write(self._master, reply)

    def _take(self) -> bytes | None:
        """The reply to the next whole frame; empty for none; None when no frame is whole."""
        start = self._buffer.find(HEADER)
        if start < 0 or len(self._buffer) < start + 3:
            return None
        end = start + 3 + self._buffer[start + 2]
        if len(self._buffer) < end:
            return None
        frame = bytes(self._buffer[start:end])
        del self._buffer[:end]
        if frame[4:6] == b"\x01\x00":
            name = self.version.encode()
            return HEADER + bytes((0, 4, len(name))) + name + b"\r\n"
        if frame[4:6] == b"\x02\x71" and wants_arming(self.version):
            self.latched = False
            return self._acknowledged()
        if frame[4:6] == b"\x02\x72" and tells_senses(self.version):
            return self._acknowledged() + self.felt
        if frame[4:6] == b"\x02\x05":
            return self._driven(frame)
        return b""

    def _driven(self, frame: bytes) -> bytes:
        if self.unheard:
            self.unheard -= 1
            return b""
        m1 = int.from_bytes(frame[6:8], "little", signed=True)
        m2 = int.from_bytes(frame[8:10], "little", signed=True)
        if self.unheard_drives and (m1 or m2):
            self.unheard_drives -= 1
            return b""
        if self.latched and (m1 or m2):
            return b""
        if not self.mute:
            self.commands.append((time.monotonic(), m1, m2))
        return self._acknowledged() if self.acknowledge else b""

    def _acknowledged(self) -> bytes:
        more, self.behind_a_reply = self.behind_a_reply, b""
        return HEADER + END + more


def _openpty(devpts: Path) -> tuple[int, int, int]:
    """As `pty.openpty`, anywhere: both ends and the number that the port has there."""
    master = os.open(devpts / "ptmx", os.O_RDWR | os.O_NOCTTY)
    fcntl.ioctl(master, _UNLOCK, struct.pack("i", 0))
    (number,) = struct.unpack("i", fcntl.ioctl(master, _NUMBER, bytes(4)))
    return master, os.open(devpts / str(number), os.O_RDWR | os.O_NOCTTY), number
