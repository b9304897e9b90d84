"""A symbolic link to a serial port, there as long as the port is."""

import fcntl
import os
from pathlib import Path

from mbot_protocol.errors import ConfigurationError


class PortLink:
    """Makes `link` lead to the port. What a dead process has left there is replaced; a file, or the
    link of a virtual robot that runs, is not.
    """

    def __init__(self, link: Path, port: str) -> None:
        """Make it.

        Raises:
            ConfigurationError: there is a file of that name, another virtual robot uses it, or the
                folder can't be written.

        """
        self._link = link
        self._port = port
        try:
            link.parent.mkdir(parents=True, exist_ok=True)
            self._lock = self._locked()
            self._make()
        except BlockingIOError:
            raise ConfigurationError(
                f"{link} is the board of another virtual robot, which still runs: end that one, or "
                "give this one its own by --board and --camera-port"
            ) from None
        except OSError as error:
            raise ConfigurationError(
                f"can't put the board's port at {link}: {error.strerror}; give --board another path"
            ) from None

    def remove(self) -> None:
        """Take the link away, unless it leads elsewhere by now."""
        if self._leads_to_port():
            self._link.unlink()
        self._lock_file.unlink(missing_ok=True)
        os.close(self._lock)

    @property
    def _lock_file(self) -> Path:
        return self._link.with_name(f".{self._link.name}.lock")

    def _locked(self) -> int:
        """The lock that goes with the process, however that ends; raises BlockingIOError."""
        lock = os.open(self._lock_file, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(lock)
            raise
        return lock

    def _make(self) -> None:
        link = self._link
        if link.exists() and not link.is_symlink():
            raise FileExistsError(0, "there is a file of that name")
        fresh = link.with_name(f".{link.name}.{os.getpid()}")
        fresh.symlink_to(self._port)
        fresh.replace(link)  # at once: whoever looks finds the old or the new port, never none

    def _leads_to_port(self) -> bool:
        try:
            return str(self._link.readlink()) == self._port
        except OSError:
            return False
