"""Files that are replaced whole or not at all, whatever the disk or the power does.

Temporary file, fsync, rename, fsync of the directory. Everything that changes the model store goes
through here, so that the tests can make each of its system calls fail, or the last one ever.
"""

# ruff: noqa: PTH104, PTH108 (through `os` alone, which the tests replace here)

import contextlib
import os
import time
from pathlib import Path

TEMPORARY = ".tmp"


def replace(path: Path, data: bytes) -> None:
    """Give `path` this content. On return it has reached the disk.

    Raises:
        OSError: it has not; the file is what it was before.

    """
    temporary = _written(path, data, durable=True)
    before = _content(path)
    try:
        os.rename(temporary, path)
    except OSError:
        _discard(temporary)
        raise
    try:
        _sync_directory(path.parent)
    except OSError:
        # The rename has happened, but who knows whether it will be there tomorrow. Refusing means
        # that the old content has to be back now.
        _put_back(path, before)
        raise


def remove(path: Path) -> None:
    """Delete a file if it is there; that this reaches the disk is not waited for."""
    with contextlib.suppress(OSError):
        os.unlink(path)


def _written(path: Path, data: bytes, *, durable: bool) -> Path:
    """A new temporary file beside `path` with this content."""
    temporary = path.with_name(f"{path.name}.{os.getpid()}.{time.monotonic_ns()}{TEMPORARY}")
    try:
        file = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
        try:
            rest = memoryview(data)
            while rest:
                rest = rest[os.write(file, rest) :]
            if durable:
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


def _put_back(path: Path, content: bytes | None) -> None:
    with contextlib.suppress(OSError):
        if content is None:
            os.unlink(path)
        else:
            os.rename(_written(path, content, durable=False), path)


def _discard(temporary: Path) -> None:
    with contextlib.suppress(OSError):
        os.unlink(temporary)


def _sync_directory(path: Path) -> None:
    directory = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(directory)
    finally:
        os.close(directory)
