"""The computer's temperature, load, memory and supply, where the kernel tells them.

A field of `Health` is the field of that name of `Decision`: nothing else has to know it.
"""

import os
import time
from dataclasses import dataclass
from pathlib import Path

_THERMAL = Path("/sys/class/thermal/thermal_zone0/temp")
_STATM = Path("/proc/self/statm")
_SENSORS = Path("/sys/class/hwmon")


@dataclass(frozen=True, slots=True)
class Health:
    """None where this machine does not tell.

    Attributes:
        cpu_temperature_c: of the processor.
        load_1min: processes that want to run, averaged over a minute.
        resident_memory_bytes: of this process.
        under_voltage: whether the supply has sagged within the last seconds.

    """

    cpu_temperature_c: float | None
    load_1min: float | None
    resident_memory_bytes: int | None
    under_voltage: bool | None = None


class SupplyAlarm:
    """A Raspberry Pi's under-voltage flag, by the sensor that Linux calls rpi_volt.

    It is up below 4.63 V within 5 % (Raspberry Pi's documentation of its power supplies).

    The kernel asks the firmware every 2 s whether it has sagged since, so reading more often tells
    nothing; and what is read stays known in between. Any thread may read.
    """

    EVERY_S = 2.0

    def __init__(self, sensors: Path = _SENSORS) -> None:
        self._sensors = sensors
        self._file: Path | None = None
        self._known: bool | None = None
        self._due_s = float("-inf")

    def read(self, monotonic_s: float) -> bool | None:
        """Whether it has sagged since the last reading, or does so still; None: no such sensor."""
        if monotonic_s >= self._due_s:
            self._due_s = monotonic_s + self.EVERY_S
            self._file, known = self._file or self._find(), None
            try:
                if self._file is not None:
                    known = self._file.read_text().strip() == "1"
            except OSError:
                self._file = None
            self._known = known
        return self._known

    def _find(self) -> Path | None:
        for name in sorted(self._sensors.glob("*/name")):
            try:
                if name.read_text().strip() == "rpi_volt":
                    return name.with_name("in0_lcrit_alarm")
            except OSError:
                continue
        return None


_SUPPLY = SupplyAlarm()


def read_health() -> Health:
    """Read all of it; takes well under a millisecond."""
    return Health(_temperature_c(), _load(), _resident_bytes(), _SUPPLY.read(time.monotonic()))


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
