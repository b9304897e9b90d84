"""How the daemon ended the last time: `control.start = "running"` holds for a clean start only."""

import logging
from pathlib import Path
from typing import Self

from mbot_protocol.files import atomic_file

log = logging.getLogger(__name__)

BOOT_ID = Path("/proc/sys/kernel/random/boot_id")
"""A new one at each start of the computer: a robot that was switched off has not crashed."""


class LastEnd:
    """A file that is there while the daemon runs. A context manager; leaving it is an orderly end.

    Attributes:
        was_crash: the daemon before this one, since the computer's start, did not end in order: it
            was killed, replaced by the watchdog, or fell over.
        unmarked: why this start could leave no mark; empty if it has.

    """

    def __init__(self, directory: Path) -> None:
        self._path = directory / "running"
        self._boot = _boot()
        self.was_crash = self._read() == self._boot
        self.unmarked = ""

    def __enter__(self) -> Self:
        """Leave the mark. A disk that refuses must not keep the robot from starting, but without a
        mark the next start would be taken for a clean one, whatever this one comes to.
        """
        try:
            atomic_file.replace(self._path, self._boot.encode())
        except OSError as error:
            self.unmarked = error.strerror or str(error)
            log.warning("can't note this start in %s: %s", self._path, self.unmarked)
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        if kind is None:
            atomic_file.remove(self._path)

    def _read(self) -> str:
        try:
            return self._path.read_text()
        except (OSError, UnicodeDecodeError):
            return ""


def _boot() -> str:
    try:
        return BOOT_ID.read_text().strip()
    except OSError:
        return "unknown"
