"""Finding and opening the mCore board's serial port."""

import fcntl
import os
import termios
from pathlib import Path

import serial
from serial.tools import list_ports

from mbot_protocol.errors import UnreachableError
from mbot_protocol.mcore import CH340

PSEUDO_TERMINALS = "/dev/pts/"
"""A simulated board holds its end open when we die, and the port would stay exclusive for ever."""

_BY_ID = Path("/dev/serial/by-id")

WRITE_TIMEOUT_S = 0.05
"""A frame takes 0.9 ms and a stop burst 5.4 ms at 115200 baud; longer means the port is stuck."""


def find_port(configured: str) -> str:
    """The path of the board's port.

    Args:
        configured: a path, returned as it is, or "auto": the only CH340 on USB.

    Raises:
        UnreachableError: "auto" found none, or several.

    """
    if configured != "auto":
        return configured
    found = [port.device for port in list_ports.comports() if (port.vid, port.pid) == CH340]
    if not found:
        raise UnreachableError(
            "no mCore board on USB (CH340, 1a86:7523): plug it in and switch it on; if lsusb shows "
            "it, brltty may have taken it (apt remove brltty); or set board.port"
        )
    if len(found) > 1:
        raise UnreachableError(
            f"several boards on USB ({', '.join(found)}): set board.port to one of "
            "/dev/serial/by-path/* (the CH340 has no serial number to tell them apart by id)"
        )
    return _stable_name(found[0])


def _stable_name(device: str) -> str:
    """The by-id link to a device: it survives being plugged in again; the device's own if none."""
    target = Path(device).resolve()
    for link in sorted(_BY_ID.glob("*")) if _BY_ID.is_dir() else ():
        if link.resolve() == target:
            return str(link)
    return device


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
    if not os.path.lexists(path):
        return f"no board at {path}: is it plugged in and switched on? (board.port)"
    if not os.access(path, os.R_OK | os.W_OK):
        return f"no permission for {path}: add this user to the group dialout and log in again"
    if "lock" in str(error).lower() or "busy" in str(error).lower():
        return f"{path} is in use by another process: a running mbot-agent? (fuser {path} names it)"
    return f"cannot open {path}: {error}"
