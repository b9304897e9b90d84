"""Files that are replaced whole or not at all, whatever the disk or the power does.

Temporary file, fsync, rename, fsync of the directory. Every file that must not be found half
written goes through here, so that the tests can make each of its system calls fail, or the last one
ever.
"""

# ruff: noqa: PTH104, PTH108 (through `os` alone, which the tests replace here)

import contextlib
import os
import time
from pathlib import Path

from mbot_protocol.errors import ConfigurationError

TEMPORARY = ".tmp"


def replace(path: Path, data: bytes, *, mode: int = 0o666) -> None:
    """Give `path` this content. On return it has reached the disk.

    Args:
        path: the file; its folder must exist.
        data: the content.
        mode: permissions of the new file, less the umask; 0o600 for what is secret.

    Raises:
        OSError: it has not; the file is what it was before, or whole and new if the disk refuses
            to put that back, too.

    """
    temporary = _written(path, data, mode)
    before = _content(path)
    try:
        os.rename(temporary, path)
    except OSError:
        _discard(temporary)
        raise
    try:
        sync_directory(path.parent)
    except OSError:
        # The rename has happened, but who knows whether it will be there tomorrow. Refusing means
        # that the old content has to be back now, and whole, should the power fail before the next.
        _put_back(path, before, mode)
        raise


def save(path: Path, data: bytes) -> None:
    """`replace` for a file that a person asked for: a device or a link stays what it is.

    Raises:
        ConfigurationError: it can't be written; it is what it was before.

    """
    try:
        if path.exists() and not path.is_file():
            path.write_bytes(data)
        else:
            replace(path.resolve(), data)
    except OSError as error:
        raise ConfigurationError(f"can't write {path}: {error.strerror}") from None


def remove(path: Path) -> None:
    """Delete a file if it is there; that this reaches the disk is not waited for."""
    with contextlib.suppress(OSError):
        os.unlink(path)


def sync_directory(path: Path) -> None:
    """What has been renamed there has reached the disk on return; raises OSError if it has not."""
    directory = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(directory)
    finally:
        os.close(directory)


def _written(path: Path, data: bytes, mode: int) -> Path:
    """A new temporary file beside `path` with this content, which has reached the disk."""
    temporary = path.with_name(f"{path.name}.{os.getpid()}.{time.monotonic_ns()}{TEMPORARY}")
    try:
        file = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, mode)
        try:
            rest = memoryview(data)
            while rest:
                rest = rest[os.write(file, rest) :]
            os.fsync(file)
        finally:
            os.close(file)
    except OSError:
        _discard(temporary)
        raise
    return temporary


def _content(path: Path) -> bytes | None:
    try:
        return path.read_bytes()
    except OSError:
        return None


def _put_back(path: Path, content: bytes | None, mode: int) -> None:
    with contextlib.suppress(OSError):
        if content is None:
            os.unlink(path)
        else:
            os.rename(_written(path, content, mode), path)


def _discard(temporary: Path) -> None:
    with contextlib.suppress(OSError):
        os.unlink(temporary)
