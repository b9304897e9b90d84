"""A serial line to a board: opened for one process alone, written, and read until woken."""

import fcntl
import os
import select
import termios
from pathlib import Path

import serial

from mbot_agent.board.board_session import BoardLostError
from mbot_protocol.errors import UnreachableError

PSEUDO_TERMINALS = "/dev/pts/"
"""A simulated board holds its end open when we die, and the port would stay exclusive for ever."""

WRITE_TIMEOUT_S = 0.05
"""An mCore's frame takes 0.9 ms and a stop burst 5.4 ms at 115200 baud; longer means the port is
stuck."""


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


def open_port(path: str, baud_rate: int) -> serial.Serial:
    """Open the port for this process alone. On a real board this resets the microcontroller.

    pyserial's lock keeps out who asks for it, TIOCEXCL everybody but root.

    Raises:
        UnreachableError: it does not exist, may not be opened, or another process holds it.

    """
    try:
        port = serial.Serial(
            path, baud_rate, timeout=0, write_timeout=WRITE_TIMEOUT_S, exclusive=True
        )
        if not os.path.realpath(path).startswith(PSEUDO_TERMINALS):
            fcntl.ioctl(port.fileno(), termios.TIOCEXCL)
        return port
    except serial.SerialException as error:
        raise UnreachableError(_explain(path, error)) from None
    except (OSError, ValueError) as error:
        raise UnreachableError(f"cannot open {path}: {error}") from None


def _explain(path: str, error: serial.SerialException) -> str:
    if not (device := Path(path).resolve()).exists():
        gone = f" (a link to {device}, which is gone)" if os.path.lexists(path) else ""
        return f"no board at {path}{gone}: is it plugged in and switched on? (board.port)"
    if "lock" in str(error).lower() or "busy" in str(error).lower():
        return f"{path} is in use by another process: a running mbot-agent? (fuser {path} names it)"
    if not os.access(path, os.R_OK | os.W_OK):
        return f"no permission for {path}: add this user to the group dialout and log in again"
    return f"cannot open {path}: {error}"
