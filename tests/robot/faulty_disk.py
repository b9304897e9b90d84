"""A disk that can fail or lose power at any system call of the model store.

It stands in for `os` in `mbot_protocol.files.atomic_file`, through which every change goes. The
files are real; beside them it keeps account of what is durable: the bytes of a file as of its last
fsync, the names in the directory as of that directory's last fsync. Everything else a power cut may
lose or keep, in any combination, a file's unsynced bytes also in part.
"""

import errno
import itertools
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

State = dict[str, bytes]
"""A directory: content by name."""


class PowerCut(BaseException):
    """Nothing after this call happens."""


@dataclass(eq=False)
class _File:
    written: bytes = b""
    synced_bytes: int = 0

    def after_power_cut(self, share: float) -> bytes:
        """With this share of the bytes that were not synced."""
        loose = len(self.written) - self.synced_bytes
        return self.written[: self.synced_bytes + round(loose * share)]


@dataclass(frozen=True)
class _Change:
    """Of the directory: `name` is gone, `target` is `file`; either may be empty."""

    name: str = ""
    target: str = ""
    file: _File = field(default_factory=_File)

    def apply(self, names: dict[str, _File]) -> None:
        names.pop(self.name, None)
        if self.target:
            names[self.target] = self.file


class FaultyDisk:
    """One directory.

    Attributes:
        calls: names of the system calls so far.
        fault: asked before each call with its number from 0 and its name; may raise.
        watch: told after each call.

    """

    def __init__(self, directory: Path) -> None:
        self.calls: list[str] = []
        self.fault: Callable[[int, str], None] = lambda _number, _name: None
        self.watch: Callable[[], None] = lambda: None
        self._directory = directory
        self._files: dict[int, _File | None] = {}
        self._names = {
            path.name: _File(data := path.read_bytes(), len(data))
            for path in (directory.iterdir() if directory.exists() else ())
        }
        self._durable = dict(self._names)
        self._pending: list[_Change] = []

    def __getattr__(self, name: str) -> object:
        return getattr(os, name)

    def open(self, path: Path, flags: int, mode: int = 0o777) -> int:
        self._enter("open")
        descriptor = os.open(path, flags, mode)
        self._files[descriptor] = None
        if flags & os.O_CREAT:
            self._files[descriptor] = self._names[path.name] = _File()
            self._pending.append(_Change("", path.name, self._names[path.name]))
        self.watch()
        return descriptor

    def write(self, descriptor: int, data: memoryview) -> int:
        """At most 1000 bytes: a short write is a write."""
        self._enter("write")
        count = os.write(descriptor, data[:1000])
        file = self._files[descriptor]
        assert file is not None
        file.written += bytes(data[:count])
        self.watch()
        return count

    def fsync(self, descriptor: int) -> None:
        self._enter("fsync")
        file = self._files[descriptor]
        if file is None:
            for change in self._pending:
                change.apply(self._durable)
            self._pending.clear()
        else:
            file.synced_bytes = len(file.written)
        self.watch()

    def close(self, descriptor: int) -> None:
        os.close(descriptor)
        del self._files[descriptor]

    def rename(self, source: Path, target: Path) -> None:
        self._enter("rename")
        source.rename(target)
        self._change(_Change(source.name, target.name, self._names[source.name]))

    def unlink(self, path: Path) -> None:
        self._enter("unlink")
        path.unlink()
        self._change(_Change(path.name))

    def after_kill(self) -> State:
        """What is there if the process dies now: everything it has done."""
        return {name: file.written for name, file in self._names.items()}

    def after_power_cut(self) -> Iterator[State]:
        """All that may be there if the power fails now."""
        sizes = (
            range(len(self._pending) + 1) if len(self._pending) <= 6 else (0, len(self._pending))
        )
        for size in sizes:
            for kept in itertools.combinations(self._pending, size):
                names = dict(self._durable)
                for change in kept:
                    change.apply(names)
                for share in (0.0, 0.5, 1.0):
                    yield {name: file.after_power_cut(share) for name, file in names.items()}

    def _enter(self, name: str) -> None:
        number = len(self.calls)
        self.calls.append(name)
        self.fault(number, name)

    def _change(self, change: _Change) -> None:
        change.apply(self._names)
        self._pending.append(change)
        self.watch()


def fails_at(number: int, code: int, *, for_good: bool = False) -> Callable[[int, str], None]:
    """A fault of one call, or of all from that one on."""

    def fault(this: int, _name: str) -> None:
        if this == number or (for_good and this > number):
            raise OSError(code, os.strerror(code))

    return fault


def dies_at(number: int) -> Callable[[int, str], None]:
    """The power fails before this call."""

    def fault(this: int, _name: str) -> None:
        if this >= number:
            raise PowerCut

    return fault


def no_fault(_number: int, _name: str) -> None:
    """All is well."""


def put(state: State, directory: Path) -> Path:
    """Make the directory what a state says."""
    directory.mkdir(parents=True, exist_ok=True)
    for path in directory.iterdir():
        path.unlink()
    for name, data in state.items():
        (directory / name).write_bytes(data)
    return directory


EIO, ENOSPC = errno.EIO, errno.ENOSPC
