"""What the firmware's tests put on the line, and what the firmware answers."""

from mbot_protocol.drive.mcore import ARM_REQUEST, Joystick

from .simulated_board import BYTE_US

Event = tuple[float, str, bytes]

NAME = b"mbot-deadman 3 300ms"
BANNER = b"Version: " + NAME + b"\r\n"
VERSION_REPLY = b"\xff\x55\x00\x04\x14" + NAME + b"\r\n"
ACKNOWLEDGED = b"\xff\x55\r\n"

UP_MS = 10
"""The banner has been sent by then."""

OFF = (0, 0)
DRIVING = (-100, 100)
DRIVE = Joystick(*DRIVING).to_bytes()


def rx(ms: float, data: bytes) -> Event:
    """These bytes from the host, the first one at this time."""
    return ms, "rx", data


ARMED = rx(UP_MS, ARM_REQUEST)


def joystick(m1: int, m2: int) -> bytes:
    """Like Joystick, without the range check."""
    speeds = (speed.to_bytes(2, "little", signed=True) for speed in (m1, m2))
    return b"\xff\x55\x07\x00\x02\x05" + b"".join(speeds)


def motor(port: int, speed: int) -> bytes:
    return b"\xff\x55\x06\x00\x02\x0a" + bytes((port,)) + speed.to_bytes(2, "little", signed=True)


def sent_us(at_ms: float, data: bytes) -> float:
    """When the last byte of a transmission has been sent."""
    return at_ms * 1000 + len(data) * BYTE_US
