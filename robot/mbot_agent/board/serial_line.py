"""A serial line to a board: written, and read until woken. What breaks it is a lost board."""

import os
import select

import serial

from mbot_agent.board.board_session import BoardLostError
from mbot_agent.board.serial_port import open_port


class SerialLine:
    """An open port. Not thread-safe.

    Attributes:
        path, baud_rate: the port's.

    """

    def __init__(self, path: str, baud_rate: int, wake_fd: int | None) -> None:
        """Open the port; `wake_fd` is a pipe that interrupts a wakeable `read`, if there is one.

        Raises:
            UnreachableError: no port, no permission, or in use.

        """
        self.path, self.baud_rate = path, baud_rate
        self._port = open_port(path, baud_rate)
        self._fd = self._port.fileno()
        self._wake_fd = wake_fd

    def close(self) -> None:
        """Let others have the port."""
        self._port.close()

    def write(self, data: bytes) -> None:
        """Write all of it.

        Raises:
            BoardLostError: the port broke.

        """
        try:
            self._port.write(data)
        except (serial.SerialException, OSError) as error:
            raise BoardLostError(f"writing to {self.path} failed: {error}") from None

    def read(self, timeout_s: float, *, wakeable: bool = False) -> bytes:
        """What has come; empty after the time-out or a wake-up.

        Raises:
            BoardLostError: the port broke.

        """
        fds = [self._fd]
        if wakeable and self._wake_fd is not None:
            fds.append(self._wake_fd)
        try:
            ready, _, _ = select.select(fds, [], [], max(0.0, timeout_s))
            if self._fd not in ready:
                return b""
            data = os.read(self._fd, 4096)
        except OSError as error:
            raise BoardLostError(f"reading from {self.path} failed: {error}") from None
        if not data:
            raise BoardLostError(f"{self.path} has been unplugged")
        return data
