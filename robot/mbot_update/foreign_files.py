"""Files of a user who is not trusted: no link on the way to them is followed."""

import os
import stat
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

_FOLDER = os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC
_FILE = os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC


@contextmanager
def folder(path: Path) -> Generator[int]:
    """A folder's descriptor, it and the one above opened as what they are; raises OSError."""
    above = os.open(path.parent, _FOLDER)
    try:
        descriptor = os.open(path.name, _FOLDER, dir_fd=above)
    finally:
        os.close(above)
    try:
        yield descriptor
    finally:
        os.close(descriptor)


def plain(name: str, descriptor: int) -> IO[bytes]:
    """A file in a folder, open for reading; raises OSError, also if it is not a plain file."""
    file = os.open(name, _FILE, dir_fd=descriptor)
    if not stat.S_ISREG(os.fstat(file).st_mode):
        os.close(file)
        raise OSError(f"{name} is not a plain file")
    return os.fdopen(file, "rb")
