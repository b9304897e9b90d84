"""The computer's temperature, load and memory, where the kernel tells them."""

import os
from dataclasses import dataclass
from pathlib import Path

_THERMAL = Path("/sys/class/thermal/thermal_zone0/temp")
_STATM = Path("/proc/self/statm")


@dataclass(frozen=True, slots=True)
class Health:
    """None where this machine does not tell."""

    cpu_temperature_c: float | None
    load_1min: float | None
    resident_memory_bytes: int | None


def read_health() -> Health:
    """Read all three; takes well under a millisecond."""
    return Health(_temperature_c(), _load(), _resident_bytes())


def anonymous_bytes() -> int:
    """Memory of this process's own, in bytes; 0 where the kernel does not tell."""
    try:
        _, resident, shared, *_ = _STATM.read_text().split()
        return (int(resident) - int(shared)) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, ValueError):
        return 0


def _temperature_c() -> float | None:
    try:
        return int(_THERMAL.read_text()) / 1000
    except (OSError, ValueError):
        return None


def _load() -> float | None:
    try:
        return os.getloadavg()[0]
    except OSError:
        return None


def _resident_bytes() -> int | None:
    try:
        return int(_STATM.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, ValueError, IndexError):
        return None
