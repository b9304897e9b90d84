"""The stock firmware of an mCore board, as far as driving goes: host bytes in, replies out.

Byte for byte it does what was measured on Makeblock's firmware 06.01.107 in an AVR simulator,
the dangerous parts included: no checksum, no time-out, and a torn frame that swallows what
follows. No I/O happens here.
"""

from mbot_protocol.drive.mcore import END, HEADER, SPEED_LIMIT, Joystick

STOCK_VERSION = "06.01.107"

_GET, _RUN, _RESET, _START = 1, 2, 4, 5
_VERSION, _JOYSTICK, _MOTOR = 0, 5, 10
_PORT_M1, _PORT_M2 = 9, 10
_TEXT = 4
ACKNOWLEDGEMENT = HEADER + END

_BUFFER_BYTES = 52
"""A frame that claims to be longer is dropped when the buffer is full (measured: a bare header
in garbage swallows about five frames)."""


class McoreFirmware:
    """The board's parser and its two motors.

    Attributes:
        version: what it answers to a version request.
        motors: what the motors do now.
        commands: how many commands that set a motor it has obeyed.

    """

    def __init__(self, version: str = STOCK_VERSION) -> None:
        self.version = version
        self.motors = Joystick(0, 0)
        self.commands = 0
        self._frame = bytearray()
        self._previous = 0

    @property
    def banner(self) -> bytes:
        """What it says unasked after a reset."""
        return f"Version: {self.version}".encode() + END

    def reset(self) -> None:
        """A reset of the processor: motors off, half a frame forgotten."""
        self.motors = Joystick(0, 0)
        self._frame.clear()
        self._previous = 0

    def feed(self, data: bytes) -> bytes:
        """Take bytes from the host; give back what the board answers."""
        replies = bytearray()
        for byte in data:
            replies += self._take(byte)
        return bytes(replies)

    def _take(self, byte: int) -> bytes:
        if not self._frame:
            # Only outside a frame is a header looked for: that is what makes torn frames bad.
            if (self._previous, byte) == tuple(HEADER):
                self._frame += HEADER
            self._previous = byte
            return b""
        self._frame.append(byte)
        length = self._frame[2]
        if len(self._frame) > 3 and len(self._frame) == 3 + length:
            frame = bytes(self._frame)
            self._end_frame()
            return self._obey(frame)
        if len(self._frame) >= _BUFFER_BYTES:
            self._end_frame()
        return b""

    def _end_frame(self) -> None:
        self._frame.clear()
        self._previous = 0

    def _obey(self, frame: bytes) -> bytes:
        body = frame[4:].ljust(6, b"\0")  # a short frame finds old bytes there; zeros will do
        action, device = body[0], body[1]
        if action == _GET:
            return self._answer(device)
        if action == _RUN:
            self._run(device, body[2:])
        elif action == _RESET:
            self._set(0, 0)
        elif action != _START:
            return b""
        return ACKNOWLEDGEMENT

    def _answer(self, device: int) -> bytes:
        if device != _VERSION:
            return b""  # sensors; this project asks for none
        text = self.version.encode()
        return HEADER + bytes((0, _TEXT, len(text))) + text + END

    def _run(self, device: int, data: bytes) -> None:
        if device == _JOYSTICK:
            self._set(_speed(data[0:2]), _speed(data[2:4]))
        elif device == _MOTOR and data[0] == _PORT_M1:
            self._set(_speed(data[1:3]), self.motors.m2)
        elif device == _MOTOR and data[0] == _PORT_M2:
            self._set(self.motors.m1, _speed(data[1:3]))

    def _set(self, m1: int, m2: int) -> None:
        self.motors = Joystick(m1, m2)
        self.commands += 1


def _speed(data: bytes) -> int:
    speed = int.from_bytes(data.ljust(2, b"\0"), "little", signed=True)
    return max(-SPEED_LIMIT, min(SPEED_LIMIT, speed))
