"""A symbolic link to a serial port, there as long as the port is."""

import os
from pathlib import Path

from mbot_protocol.errors import ConfigurationError


class PortLink:
    """Makes `link` lead to the port; an old link there is replaced, a file is not."""

    def __init__(self, link: Path, port: str) -> None:
        """Make it.

        Raises:
            ConfigurationError: there is a file of that name, or the folder can't be written.

        """
        self._link = link
        self._port = port
        try:
            self._make()
        except OSError as error:
            raise ConfigurationError(
                f"can't put the board's port at {link}: {error.strerror}; give --board another path"
            ) from None

    def remove(self) -> None:
        """Take the link away, unless it leads elsewhere by now."""
        if self._leads_to_port():
            self._link.unlink()

    def _make(self) -> None:
        link = self._link
        if link.exists() and not link.is_symlink():
            raise FileExistsError(0, "there is a file of that name")
        link.parent.mkdir(parents=True, exist_ok=True)
        fresh = link.with_name(f".{link.name}.{os.getpid()}")
        fresh.symlink_to(self._port)
        fresh.replace(link)  # at once: whoever looks finds the old or the new port, never none

    def _leads_to_port(self) -> bool:
        try:
            return str(self._link.readlink()) == self._port
        except OSError:
            return False
