"""Files and folders that a command will write: what is in the way is said before the work."""

import os
from pathlib import Path

from mbot_protocol.errors import ConfigurationError

PICTURES = (".png", ".svg", ".pdf")
"""What figures can be written as."""


def check_output_file(path: Path, name: str, endings: tuple[str, ...] = ()) -> None:
    """Check that a file can be written.

    Args:
        path: of the file.
        name: of the option that named it, such as --result.
        endings: one of which it must have; any if empty.

    Raises:
        ConfigurationError: it is a folder, its folder is missing or closed, or its ending unknown.

    """
    folder = path.absolute().parent
    if path.is_dir():
        raise ConfigurationError(f"{name} is {path}, which is a folder; expected a file's name")
    if endings and path.suffix.lower() not in endings:
        raise ConfigurationError(
            f"{name} is {path}, expected a name that ends in {' or '.join(endings)}"
        )
    if not folder.is_dir():
        raise ConfigurationError(
            f"{name} is {path}, but there is no folder {folder}: make it first"
        )
    if not os.access(path if path.exists() else folder, os.W_OK):
        raise ConfigurationError(f"{name} is {path}, which you may not write")


def check_new_file(path: Path) -> None:
    """Check that nothing is overwritten; raises ConfigurationError."""
    if path.exists():
        raise ConfigurationError(f"{path} exists already; choose another name")


def check_output_folder(path: Path, name: str) -> None:
    """Check that a folder can be made or written into; raises as `check_output_file`."""
    there = path.absolute()
    while not there.exists():
        there = there.parent
    if not there.is_dir():
        raise ConfigurationError(f"{name} is {path}, but {there} is a file; expected a folder")
    if not os.access(there, os.W_OK):
        raise ConfigurationError(f"{name} is {path}, but you may not write into {there}")
