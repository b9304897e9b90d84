"""One open connection to the board: handshake, frames out, acknowledgements in.

Not thread-safe: the motor thread alone uses it, so that no frame is ever torn by another.
"""

import os
import select
import time
from collections.abc import Callable
from typing import Self

import serial

from mbot_agent.board import board_port
from mbot_protocol.drive import mcore
from mbot_protocol.drive.mcore import (
    Acknowledgement,
    Banner,
    Joystick,
    Reply,
    ReplyParser,
    VersionReply,
)
from mbot_protocol.errors import UnreachableError

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


class BoardLostError(UnreachableError):
    """The port broke, or the board stopped answering, in mid-session."""


class BoardResetError(BoardLostError):
    """The board has announced that it has just been reset; its motors are off."""


class BoardSession:
    """An exclusive, handshaken connection. As a context manager it stops the motors at its end.

    Attributes:
        path: the port.
        version: the firmware's name of itself.

    """

    def __init__(self, path: str, port: serial.Serial, wake_fd: int) -> None:
        """Take over an open port; `wake_fd` is a pipe that interrupts `wait`."""
        self.path = path
        self.version = ""
        self._port = port
        self._fd = port.fileno()
        self._wake_fd = wake_fd
        self._parser = ReplyParser()

    @classmethod
    def open(cls, configured: str, baud_rate: int, wake_fd: int) -> "BoardSession":
        """Find and open the port. Nothing has been sent yet; call `handshake`.

        Raises:
            UnreachableError: no port, no permission, or in use.

        """
        path = board_port.find_port(configured)
        return cls(path, board_port.open_port(path, baud_rate), wake_fd)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        try:
            if not isinstance(error, BoardLostError):
                self.stop()
        except BoardLostError:
            pass  # nothing more can be done over this wire; a real board resets as the port closes
        finally:
            self._port.close()

    def handshake(self, giving_up: Callable[[], bool]) -> bool:
        """Stop whatever the board was doing, then ask for its version until it answers.

        Args:
            giving_up: asked between attempts; true ends the handshake early.

        Returns:
            Whether the board answered; false only after giving up.

        Raises:
            BoardLostError: no answer in 6 s.

        """
        self._write(mcore.stop_burst())
        deadline = time.monotonic() + HANDSHAKE_TIMEOUT_S
        while time.monotonic() < deadline and not giving_up():
            self._write(mcore.VERSION_REQUEST)
            again = time.monotonic() + VERSION_INTERVAL_S
            # Not wakeable: whoever wants to drive meanwhile has to wait, and must not be spun for.
            while time.monotonic() < again:
                for reply in self._read(again - time.monotonic()):
                    if isinstance(reply, VersionReply):
                        self.version = reply.version
                        self.stop()
                        return True
        if giving_up():
            return False
        raise BoardLostError(
            f"no answer from {self.path} at {self._port.baudrate} baud in "
            f"{HANDSHAKE_TIMEOUT_S:.0f} s: wrong port, wrong board.baud_rate, or no mCore firmware"
        )

    def send(self, joystick: Joystick) -> tuple[int, int]:
        """Write one command and wait for its acknowledgement.

        Returns:
            Monotonic times in ns: when the write began, when the acknowledgement was read.

        Raises:
            BoardLostError: the port broke, or no acknowledgement came in 50 ms.
            BoardResetError: the board has been reset.

        """
        return self._exchange(joystick.to_bytes())

    def stop(self) -> None:
        """Flush the board's parser and stop the motors, repeated until twice acknowledged.

        Raises:
            BoardLostError: it was not acknowledged in 8 attempts of 50 ms, or the port broke.
            BoardResetError: the board has been reset; its motors are off.

        """
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

    @property
    def may_latch(self) -> bool:
        """Whether the firmware refuses to drive after a reset or a silence until it is armed."""
        return mcore.wants_arming(self.version)

    def arm(self) -> None:
        """Let a board that has latched drive again; nothing is sent to firmware that never does.

        Raises:
            BoardLostError, BoardResetError: as `send`.

        """
        if self.may_latch:
            self._exchange(mcore.ARM_REQUEST)

    def wait(self, timeout_s: float) -> None:
        """Sleep until the time-out, a wake-up or news from the board; take in what it says.

        Raises:
            BoardLostError: the port broke.
            BoardResetError: the board has been reset.

        """
        for reply in self._read(timeout_s, wakeable=True):
            if isinstance(reply, Banner):
                raise BoardResetError(f"the board on {self.path} has been reset ({reply.version})")

    def _exchange(self, frame: bytes) -> tuple[int, int]:
        self._drain()
        written_ns = time.monotonic_ns()
        self._write(frame)
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

    def _write(self, data: bytes) -> None:
        try:
            self._port.write(data)
        except (serial.SerialException, OSError) as error:
            raise BoardLostError(f"writing to {self.path} failed: {error}") from None

    def _read(self, timeout_s: float, *, wakeable: bool = False) -> list[Reply]:
        fds = [self._fd, self._wake_fd] if wakeable else [self._fd]
        try:
            ready, _, _ = select.select(fds, [], [], max(0.0, timeout_s))
            if self._fd not in ready:
                return []
            data = os.read(self._fd, 4096)
        except OSError as error:
            raise BoardLostError(f"reading from {self.path} failed: {error}") from None
        if not data:
            raise BoardLostError(f"{self.path} has been unplugged")
        return list(self._parser.feed(data))


class UnacknowledgedError(BoardLostError):
    """The board did not acknowledge one frame in time; it may acknowledge the next."""
