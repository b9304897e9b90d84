"""The mCore board's serial protocol: range-checked values to bytes, and replies back from bytes.

No I/O happens here. The layout was measured on Makeblock's stock firmware (versions 06.01.009,
06.01.107 and 1.2.103) running in an AVR simulator; see docs/mcore-protocol.md.

A command is `ff 55 len idx action device data...` with no checksum, so the board believes
whatever arrives: a frame that is torn can turn the next one into full speed. Hence `stop_burst`,
which first flushes the board's parser with zero bytes.
"""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from mbot_protocol.drive.actions import AS_BUILT, WheelMaps
from mbot_protocol.drive.senses import Senses
from mbot_protocol.drive.wheel_command import Duties

BAUD_RATE = 115_200
CH340 = (0x1A86, 0x7523)
"""USB vendor and product of the mCore's serial chip (public)."""

SPEED_LIMIT = 255
"""The board clips speeds to +-255 (measured)."""

HEADER = b"\xff\x55"
END = b"\r\n"

_GET, _RUN, _RESET = 1, 2, 4
_VERSION, _JOYSTICK = 0, 5
_RESET_CAUSE, _ARM, _SENSES = 0x70, 0x71, 0x72

FLUSH_PADDING = bytes(52)
"""Zero bytes that end any half-read frame: the stock parser's buffer holds 52 bytes (measured)."""


@dataclass(frozen=True, slots=True)
class Joystick:
    """A speed for both motors at once, as the board counts it: M1 and M2 in -255..255.

    M1 is the left motor. Forward is M1 negative, M2 positive (measured).

    Raises:
        ValueError: a speed is not a whole number in -255..255.

    """

    m1: int
    m2: int

    def __post_init__(self) -> None:
        for name, speed in (("m1", self.m1), ("m2", self.m2)):
            if type(speed) is not int or not -SPEED_LIMIT <= speed <= SPEED_LIMIT:
                raise ValueError(
                    f"{name} is {speed!r}, expected a whole number in -{SPEED_LIMIT}..{SPEED_LIMIT}"
                )

    @classmethod
    def of(cls, motors: Duties) -> "Joystick":
        """Of the motors' duties, left and right, positive as the motor runs."""
        return cls(round(motors.left * SPEED_LIMIT), round(motors.right * SPEED_LIMIT))

    @property
    def is_stop(self) -> bool:
        """Whether both motors are off."""
        return self.m1 == 0 and self.m2 == 0

    @property
    def duties(self) -> Duties:
        """Of the wheels of an mBot, positive is forward."""
        return AS_BUILT.of_levels(self.m1, self.m2)

    def to_bytes(self) -> bytes:
        """The ten bytes for the wire; the speeds are int16, little-endian."""
        return (
            HEADER
            + bytes((0x07, 0x00, _RUN, _JOYSTICK))
            + self.m1.to_bytes(2, "little", signed=True)
            + self.m2.to_bytes(2, "little", signed=True)
        )


STOP = Joystick(0, 0)
VERSION_REQUEST = HEADER + bytes((0x03, 0x00, _GET, _VERSION))
RESET_REQUEST = HEADER + bytes((0x02, 0x00, _RESET))

# Our own firmware's, deploy/firmware; the stock firmware has no such devices.
ARM_REQUEST = HEADER + bytes((0x03, 0x00, _RUN, _ARM))
RESET_CAUSE_REQUEST = HEADER + bytes((0x03, 0x00, _GET, _RESET_CAUSE))

LONGEST_STOPPING_CM = 255


def senses_request(
    line_ports: Iterable[int],
    ultrasonic_port: int,
    stopping_distance_m: float,
    wheels: WheelMaps = AS_BUILT,
    *,
    edge_stops: bool,
) -> bytes:
    """Have our firmware tell its senses 20 times a second, and hold the robot back by itself.

    Args:
        line_ports: RJ25 ports, 1 to 4, that have infrared pairs; none: it tells of a floor.
        ultrasonic_port: that of the ultrasonic sensor; 0: none.
        stopping_distance_m: an echo that is nearer cuts forward; 0: none does.
        wheels: which motors are reversed, so what forward is.
        edge_stops: whether no floor cuts forward.

    """
    flags = edge_stops | (not wheels.left.reversed) << 1 | bool(wheels.right.reversed) << 2
    ports = sum({1 << port - 1 for port in line_ports})
    stop_cm = min(LONGEST_STOPPING_CM, round(stopping_distance_m * 100))
    return HEADER + bytes((0x07, 0x00, _RUN, _SENSES, flags, ports, ultrasonic_port, stop_cm))


def stop_burst() -> bytes:
    """Padding, then STOP: stops the motors whatever the board's parser was in the middle of.

    62 bytes, 5.4 ms at 115200 baud, and less than the board's 64-byte receive buffer.
    """
    return FLUSH_PADDING + STOP.to_bytes()


@dataclass(frozen=True, slots=True)
class Acknowledgement:
    """The board executed a RUN, RESET or START; it does not say which (measured)."""


@dataclass(frozen=True, slots=True)
class VersionReply:
    """The answer to VERSION_REQUEST."""

    version: str


@dataclass(frozen=True, slots=True)
class Banner:
    """An unsolicited `Version: ...` line: the board has just been reset; its motors are off."""

    version: str


@dataclass(frozen=True, slots=True)
class Value:
    """Any other framed reply: our firmware's senses; the stock one's button and sensors."""

    index: int
    data: bytes

    @property
    def senses(self) -> Senses | None:
        """What our firmware tells of its senses; None: it is something else."""
        if self.index != _SENSES or len(self.data) != _SENSES_BYTES:
            return None
        told, supply = self.data[2:]
        return Senses(
            distance_m=int.from_bytes(self.data[:2], "little") / 1000,
            floor=(bool(told & 1), bool(told & 2)),
            at_edge=bool(told & 4),
            at_obstacle=bool(told & 8),
            supply_v=supply * _SUPPLY_V or None,
        )


_SENSES_BYTES = 4
_SUPPLY_V = 0.02
"""What one of the supply's units is."""

Reply = Acknowledgement | VersionReply | Banner | Value

_STRING = 4
_FIXED_SIZES = {1: 1, 2: 4, 3: 2, 5: 4, 6: 4}
"""Bytes of data by type code: byte, float, short, double (a float on the AVR), long."""

_LONGEST_STRING = 32
"""Versions are 7 to 9 characters long; believing a longer length would swallow later replies."""

_BANNER_PREFIX = b"Version: "
_PRINTABLE_FIRST, _PRINTABLE_LAST = 0x20, 0x7E
_LONGEST_LINE = 64


class ReplyParser:
    """Turns the board's bytes, in whatever pieces they come, into replies.

    Unknown bytes are dropped one at a time until something parses again, so it never gets stuck
    and never holds more than `LONGEST` bytes.
    """

    LONGEST = _LONGEST_LINE + 1

    def __init__(self) -> None:
        self._buffer = bytearray()

    @property
    def pending(self) -> int:
        """Bytes held back because they may be the start of a reply."""
        return len(self._buffer)

    def feed(self, data: bytes) -> Iterator[Reply]:
        """Yield the replies that `data` completes, in order."""
        for byte in data:
            self._buffer.append(byte)
            while self._buffer:
                taken, reply = _take(self._buffer)
                if taken == 0:
                    break
                del self._buffer[:taken]
                if reply is not None:
                    yield reply


def _take(buffer: bytearray) -> tuple[int, Reply | None]:
    """How many bytes at the front are done with, and the reply they make, if any."""
    if buffer[0] == HEADER[0]:
        return _take_frame(buffer)
    if buffer[0] == _BANNER_PREFIX[0]:
        return _take_banner(buffer)
    return 1, None


def _take_frame(buffer: bytearray) -> tuple[int, Reply | None]:
    if len(buffer) >= 2 and buffer[1] != HEADER[1]:
        return 1, None
    if len(buffer) < 4:
        return 0, None
    if buffer.startswith(END, 2):
        return 4, Acknowledgement()
    index, kind = buffer[2], buffer[3]
    if kind == _STRING:
        if len(buffer) < 5:
            return 0, None
        start, size = 5, buffer[4]
        if size > _LONGEST_STRING:
            return 1, None
    elif kind in _FIXED_SIZES:
        start, size = 4, _FIXED_SIZES[kind]
    else:
        return 1, None
    if len(buffer) < start + size + len(END):
        return 0, None
    if not buffer.startswith(END, start + size):
        return 1, None
    data = bytes(buffer[start : start + size])
    taken = start + size + len(END)
    if kind == _STRING and index == 0:
        return taken, VersionReply(data.decode("ascii", "replace"))
    return taken, Value(index, data)


def _take_banner(buffer: bytearray) -> tuple[int, Reply | None]:
    shared = min(len(buffer), len(_BANNER_PREFIX))
    if not buffer.startswith(_BANNER_PREFIX[:shared]) or len(buffer) > _LONGEST_LINE:
        return 1, None
    version, end, _ = buffer[len(_BANNER_PREFIX) :].partition(END)
    if not all(_PRINTABLE_FIRST <= byte <= _PRINTABLE_LAST for byte in version.rstrip(b"\r")):
        return 1, None
    if not end:
        return 0, None
    return len(_BANNER_PREFIX) + len(version) + len(END), Banner(version.decode().strip())


_DEADMAN_PREFIX = "mbot-deadman"

_MAKEBLOCK = re.compile(r"(?P<board>[0-9a-f]{2})\.\d\d\.\d{3}")
_MBOT = "06"


def is_of_another_board(version: str) -> bool:
    """Whether a firmware of this name is Makeblock's for another board than the mCore.

    They speak the same protocol; motors, ports and signs are others. All are called "BB.NN.NNN", BB
    being the board: 06 the mBot's, 09 and 10 Auriga's, 0e MegaPi's (Makeblock-Libraries).
    """
    found = _MAKEBLOCK.fullmatch(version)
    return found is not None and found["board"] != _MBOT


def has_deadman(version: str) -> bool:
    """Whether a firmware of this name stops the motors by itself when commands cease.

    Makeblock's stock firmware keeps the last command for ever (180 s of silence measured).
    """
    return version.startswith(_DEADMAN_PREFIX)


_OURS = re.compile(rf"{_DEADMAN_PREFIX} (?P<generation>\d+)(?: (?P<timeout_ms>\d+)ms)?")


def wants_arming(version: str) -> bool:
    """Whether a firmware of this name refuses to drive until ARM has come."""
    found = _OURS.match(version)
    return found is not None and int(found["generation"]) >= 2


def tells_senses(version: str) -> bool:
    """Whether a firmware of this name reads the kit's sensors without ever waiting for them.

    The stock one does not: an ultrasonic sensor without an echo makes it deaf for 0.88 s, to STOP
    as well (measured).
    """
    found = _OURS.match(version)
    return found is not None and int(found["generation"]) >= 3


def deadman_timeout_ms(version: str) -> int | None:
    """After how long a silence a firmware of this name stops; None where it does not tell."""
    found = _OURS.match(version)
    return int(found["timeout_ms"]) if found is not None and found["timeout_ms"] else None


_RESET_CAUSES = {1: "power", 2: "reset pin", 4: "brown-out", 8: "watchdog"}


def reset_cause(flags: int) -> str:
    """The ATmega328P's MCUSR in words (data sheet, 11.9.1); a boot loader may have cleared it."""
    found = [word for bit, word in _RESET_CAUSES.items() if flags & bit]
    return ", ".join(found) or "unknown"
