"""Finding the mCore's serial port: its CH340 on USB."""

from pathlib import Path

from serial.tools import list_ports
from serial.tools.list_ports_common import ListPortInfo

from mbot_protocol.drive.mcore import CH340
from mbot_protocol.errors import UnreachableError

_BY_ID = Path("/dev/serial/by-id")
_USB_DEVICES = Path("/sys/bus/usb/devices")


def find_port(configured: str) -> str:
    """The path of the board's port.

    Args:
        configured: a path, returned as it is, or "auto": the only CH340 on USB.

    Raises:
        UnreachableError: "auto" found none, or several.

    """
    if configured != "auto":
        return configured
    found = [port.device for port in _usb_ports() if (port.vid, port.pid) == CH340]
    if not found:
        raise UnreachableError(_explain_none())
    if len(found) > 1:
        raise UnreachableError(
            f"several boards on USB ({', '.join(found)}): set board.port to one of "
            "/dev/serial/by-path/* (the CH340 has no serial number to tell them apart by id)"
        )
    return _stable_name(found[0])


def _usb_ports() -> list[ListPortInfo]:
    return [port for port in list_ports.comports() if port.vid is not None]


def _explain_none() -> str:
    """Why there is no port of an mCore: what is there instead."""
    plugged = {_usb_id(folder) for folder in _USB_DEVICES.glob("*")}
    if CH340 in plugged:
        return (
            "the mCore's CH340 (1a86:7523) is on USB and has no serial port: brltty may have taken "
            "it (apt remove brltty), or the kernel's ch341 is missing (modprobe ch341)"
        )
    none = "no mCore board on USB (CH340, 1a86:7523)"
    if others := _usb_ports():
        names = ", ".join(f"{port.device} ({port.vid:04x}:{port.pid:04x})" for port in others)
        return f"{none}, but {names}: if that is the board, set board.port to it"
    vendor = CH340[0]
    if kin := [f"{vendor:04x}:{pid:04x}" for vid, pid in sorted(plugged) if vid == vendor]:
        return (
            f"{none}, but {', '.join(kin)}, of the same maker: a CH341 that is wired for something "
            "else than a serial port, or a chip that this kernel has no driver for (dmesg)"
        )
    return f"{none}: plug it in and switch it on, or set board.port"


def _usb_id(folder: Path) -> tuple[int, int]:
    """Vendor and product of a device on USB; zeros of what is none, such as an interface."""
    try:
        vendor, product = (
            int((folder / name).read_text(), 16) for name in ("idVendor", "idProduct")
        )
    except (OSError, ValueError):
        return 0, 0
    return vendor, product


def _stable_name(device: str) -> str:
    """The by-id link to a device: it survives being plugged in again; the device's own if none."""
    target = Path(device).resolve()
    for link in sorted(_BY_ID.glob("*")) if _BY_ID.is_dir() else ():
        if link.resolve() == target:
            return str(link)
    return device
