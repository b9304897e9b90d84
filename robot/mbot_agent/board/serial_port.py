"""Opening a serial port for one process alone, and why it cannot be opened."""

import fcntl
import os
import termios
from pathlib import Path

import serial

from mbot_protocol.errors import UnreachableError

PSEUDO_TERMINALS = "/dev/pts/"
"""A simulated board holds its end open when we die, and the port would stay exclusive for ever."""

WRITE_TIMEOUT_S = 0.05
"""An mCore's frame takes 0.9 ms and a stop burst 5.4 ms at 115200 baud; longer means the port is
stuck."""


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
