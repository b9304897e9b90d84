"""One open connection to an mCore: handshake, frames out, acknowledgements in.

Not thread-safe: the motor thread alone uses it, so that no frame is ever torn by another.
"""

import time
from collections.abc import Callable
from typing import Self

from mbot_agent.board.board_session import (
    BoardLostError,
    BoardResetError,
    Firmware,
    UnacknowledgedError,
)
from mbot_agent.board.mcore import mcore_port
from mbot_agent.board.serial_line import SerialLine
from mbot_agent.configuration import BoardSettings, SensesSettings
from mbot_protocol.drive import mcore
from mbot_protocol.drive.actions import WheelMaps
from mbot_protocol.drive.mcore import (
    Acknowledgement,
    Banner,
    Joystick,
    Reply,
    ReplyParser,
    Value,
    VersionReply,
)
from mbot_protocol.drive.senses import Senses
from mbot_protocol.drive.wheel_command import Duties

HANDSHAKE_TIMEOUT_S = 6.0
"""From opening the port to the first obeyed command takes 2.6 to 3.5 s through the boot loader."""

VERSION_INTERVAL_S = 0.2
"""What is sent during the boot is lost, so the question is repeated."""

ACKNOWLEDGE_TIMEOUT_S = 0.05
"""Write to reply takes 2 to 3 ms (measured); this is late enough to call a reply lost."""

STOP_REPEATS = 2
"""Acknowledged stop bursts that make a stop certain. Flushing a torn frame may itself be
acknowledged, so the first acknowledgement proves nothing."""

STOP_ATTEMPTS = 8
"""Eight stop frames in a row recovered the stock parser from every torn frame (measured)."""


class McoreSession:
    """A `BoardSession`, handshaken.

    Attributes:
        path: the port.
        firmware: what has answered.
        senses: what it told of them last.

    """

    senses: Senses | None

    def __init__(self, line: SerialLine) -> None:
        """Take over an open line."""
        self.path = line.path
        self.firmware = Firmware()
        self.senses = None
        self._line = line
        self._parser = ReplyParser()

    @classmethod
    def open(cls, board: BoardSettings, wake_fd: int | None) -> "McoreSession":
        """Find and open the port, which resets a real board. Nothing has been sent yet.

        Raises:
            UnreachableError: no port, no permission, or in use.

        """
        return cls(SerialLine(mcore_port.find_port(board.port), board.baud_rate, wake_fd))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        try:
            if not isinstance(error, BoardLostError):
                self.stop()
        except BoardLostError:
            pass  # nothing more can be done over this wire; a real board resets as the port closes
        finally:
            self._line.close()

    def handshake(self, giving_up: Callable[[], bool]) -> bool:
        """Stop whatever the board was doing, then ask for its version until it answers, 6 s."""
        self._line.write(mcore.stop_burst())
        deadline = time.monotonic() + HANDSHAKE_TIMEOUT_S
        while time.monotonic() < deadline and not giving_up():
            self._line.write(mcore.VERSION_REQUEST)
            again = time.monotonic() + VERSION_INTERVAL_S
            # Not wakeable: whoever wants to drive meanwhile has to wait, and must not be spun for.
            while time.monotonic() < again:
                for reply in self._read(again - time.monotonic()):
                    if isinstance(reply, VersionReply):
                        self.firmware = firmware(reply.version)
                        self.stop()
                        return True
        if giving_up():
            return False
        raise BoardLostError(
            f"no answer from {self.path} at {self._line.baud_rate} baud in "
            f"{HANDSHAKE_TIMEOUT_S:.0f} s: wrong port, wrong board.baud_rate, or no mCore firmware"
        )

    def send(self, motors: Duties) -> tuple[int, int]:
        """Write one frame and wait for its acknowledgement, 50 ms."""
        return self._exchange(Joystick.of(motors).to_bytes())

    def stop(self) -> None:
        """Flush the board's parser and stop the motors, repeated until twice acknowledged."""
        acknowledged = 0
        for _ in range(STOP_ATTEMPTS):
            try:
                self._exchange(mcore.stop_burst())
            except UnacknowledgedError:
                continue
            acknowledged += 1
            if acknowledged == STOP_REPEATS:
                return
        raise BoardLostError(f"{self.path} does not acknowledge the stop command")

    def arm(self) -> None:
        """Let firmware of ours that has latched drive again."""
        if self.firmware.may_latch:
            self._exchange(mcore.ARM_REQUEST)

    def watch(self, settings: SensesSettings, wheels: WheelMaps) -> bool:
        """Tell firmware of ours what to look at; it forgets that with each reset."""
        self.senses = None
        if not mcore.tells_senses(self.firmware.version):
            return False
        on = settings.are_read
        request = mcore.senses_request(
            settings.line_ports if on else (),
            settings.ultrasonic_port if on else 0,
            settings.distance_m,
            wheels,
            edge_stops=settings.edge == "stop",
        )
        self._exchange(request)
        return on

    def wait(self, timeout_s: float) -> None:
        """Sleep until the time-out, a wake-up or news from the board; take in what it says."""
        for reply in self._read(timeout_s, wakeable=True):
            if isinstance(reply, Banner):
                raise BoardResetError(f"the board on {self.path} has been reset ({reply.version})")

    def _exchange(self, frame: bytes) -> tuple[int, int]:
        self._drain()
        written_ns = time.monotonic_ns()
        self._line.write(frame)
        deadline = time.monotonic() + ACKNOWLEDGE_TIMEOUT_S
        while (left := deadline - time.monotonic()) > 0:
            replies = self._read(left)
            # All of them are looked at: a banner behind the acknowledgement counts too.
            if any(isinstance(reply, Banner) for reply in replies):
                raise BoardResetError(f"the board on {self.path} has been reset")
            if any(isinstance(reply, Acknowledgement) for reply in replies):
                return written_ns, time.monotonic_ns()
        raise UnacknowledgedError(f"{self.path} does not acknowledge commands")

    def _drain(self) -> None:
        """Take in late replies, so that an old acknowledgement is not taken for the next one's."""
        for reply in self._read(0.0):
            if isinstance(reply, Banner):
                raise BoardResetError(f"the board on {self.path} has been reset")

    def _read(self, timeout_s: float, *, wakeable: bool = False) -> list[Reply]:
        replies = list(self._parser.feed(self._line.read(timeout_s, wakeable=wakeable)))
        told = [reply.senses for reply in replies if isinstance(reply, Value)]
        self.senses = next((one for one in reversed(told) if one is not None), self.senses)
        return replies


def firmware(version: str) -> Firmware:
    """What a firmware of this name can do."""
    mistaken = (
        f"the firmware ({version}) is Makeblock's for another board than the mBot's mCore "
        "(06.xx.xxx): motors may turn otherwise than they are told; connect an mCore, or set "
        "board.port to its port"
    )
    return Firmware(
        version,
        has_deadman=mcore.has_deadman(version),
        may_latch=mcore.wants_arming(version),
        mistaken=mistaken if mcore.is_of_another_board(version) else "",
    )
