"""Recordings on disk: a folder a drive, a file every few minutes of it, and what goes to make room.

Used by two threads, the recorder's and the one that answers queries; each copes with files that the
other has just removed. Who keeps a drive marks it, and nothing removes it but a person.
"""

import contextlib
import hashlib
import os
import re
import shutil
from collections.abc import Generator, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from mbot_agent import configuration
from mbot_protocol.errors import RefusedError
from mbot_protocol.files import atomic_file

NEWEST_STAY = 10
"""Drives that do not go for their age, and by whose dates others are old. No clock is asked: a Pi
has none that runs on without power, and one that is months ahead costs no drive before ten in a row
have its date."""

_DRIVE = re.compile(r"drive-(\d{4,9})-(\d{8}-\d{6})")
"""Counted, since a robot's clock may go back; and dated, in UTC, for people."""
_FILE = re.compile(r"\d{3,6}\.mcap")
_KEPT, _LAST = "kept", "last-drive"
_DATE = "%Y%m%d-%H%M%S"
_BLOCK_BYTES = 1 << 20


@dataclass(frozen=True, slots=True)
class StoredFile:
    """A file of a recording, of its size on disk now."""

    path: Path
    size_bytes: int
    written_unix_time_ns: int


@dataclass(frozen=True, slots=True)
class StoredDrive:
    """One drive: its files in order; `kept` is what a person has marked."""

    name: str
    files: tuple[StoredFile, ...]
    started_unix_time_ns: int
    kept: bool

    @property
    def ended_unix_time_ns(self) -> int:
        """When the last of it was written."""
        written = [file.written_unix_time_ns for file in self.files]
        return max(written, default=self.started_unix_time_ns)


class RecordingDirectory:
    """The drives under one directory, which is made when the first one begins.

    Attributes:
        open_drive: the drive that is being recorded; empty: none.

    """

    def __init__(self, path: Path, settings: configuration.Recording) -> None:
        self._path = path
        self._settings = settings
        self.open_drive = ""

    def new_drive(self) -> Path:
        """Make the folder of another drive; its number was never used before.

        Raises:
            OSError: it cannot be made.

        """
        self._path.mkdir(parents=True, exist_ok=True)
        last = self._path / _LAST
        number = 0
        with contextlib.suppress(OSError, ValueError):
            number = int(last.read_text())
        number = 1 + max([number, *(_number(folder.name) for folder in self._folders())])
        atomic_file.replace(last, f"{number}\n".encode())
        folder = self._path / f"drive-{number:04d}-{datetime.now(UTC):{_DATE}}"
        folder.mkdir()
        return folder

    def drives(self) -> list[StoredDrive]:
        """All drives, oldest first; none where the directory is not there or cannot be read."""
        return [drive for folder in self._folders() if (drive := _stored(folder)) is not None]

    @property
    def free_bytes(self) -> int:
        """What may still be written on this card, by anybody.

        Raises:
            OSError: the card does not answer.

        """
        there = next(p for p in (self._path, *self._path.parents) if p.exists())
        return shutil.disk_usage(there).free

    def make_room(self) -> str:
        """Remove what is too old or too much, oldest first.

        Returns:
            Why there is no room all the same; empty: there is.

        Raises:
            OSError: the card does not answer.

        """
        settings, drives = self._settings, self.drives()
        total_bytes = sum(file.size_bytes for drive in drives for file in drive.files)
        old = {drive.name for drive in drives[:-NEWEST_STAY]}
        today_ns = min((one.ended_unix_time_ns for one in drives[-NEWEST_STAY:]), default=0)
        too_old_ns = today_ns - round(settings.longest_days * 86_400e9)
        for drive, file in self._removable(drives):
            outdated = drive.name in old and file.written_unix_time_ns < too_old_ns
            too_much = total_bytes > settings.largest_mb * 1e6
            if not (outdated or too_much or self.free_bytes < settings.leave_free_mb * 1e6):
                continue
            file.path.unlink(missing_ok=True)
            total_bytes -= file.size_bytes
            if drive.name != self.open_drive and file is drive.files[-1]:
                shutil.rmtree(file.path.parent, ignore_errors=True)
        free_mb = self.free_bytes / 1e6
        if free_mb < settings.leave_free_mb:
            return (
                f"{free_mb:.0f} MB are free, recording.leave_free_mb leaves "
                f"{settings.leave_free_mb:.0f} to others"
            )
        if total_bytes > settings.largest_mb * 1e6:
            return (
                f"what is kept takes {total_bytes / 1e6:.0f} MB of recording.largest_mb = "
                f"{settings.largest_mb:.0f}: `workstation recordings keep --no` or `remove` some"
            )
        return ""

    def read(self, drive: str, file: str, offset_bytes: int, count_bytes: int) -> bytes:
        """A part of a file; shorter where it ends.

        Raises:
            RefusedError: there is no such file, or it cannot be read.

        """
        with self._opened(drive, file) as descriptor:
            return os.pread(descriptor, count_bytes, offset_bytes)

    def digest(self, drive: str, file: str, size_bytes: int) -> str:
        """SHA-256 of a file's first bytes, hexadecimal; raises as `read`, and if it is shorter."""
        hashed, at = hashlib.sha256(), 0
        with self._opened(drive, file) as descriptor:
            while at < size_bytes:
                block = os.pread(descriptor, min(_BLOCK_BYTES, size_bytes - at), at)
                if not block:
                    raise RefusedError(f"{drive}/{file} has {at} bytes, expected {size_bytes}")
                hashed.update(block)
                at += len(block)
        return hashed.hexdigest()

    def keep(self, drive: str, kept: bool) -> None:
        """Mark a drive so that it stays, or take the mark away.

        Raises:
            RefusedError: there is no such drive, or the mark cannot be written.

        """
        mark = self._folder(drive) / _KEPT
        try:
            if kept:
                atomic_file.replace(mark, b"")
            else:
                mark.unlink(missing_ok=True)
        except OSError as error:
            raise RefusedError(f"cannot mark {drive}: {error.strerror}") from None

    def remove(self, drive: str) -> None:
        """Remove a drive for good.

        Raises:
            RefusedError: there is no such drive, it is kept, it is being recorded, or it cannot be
                removed.

        """
        folder = self._folder(drive)
        if drive == self.open_drive:
            raise RefusedError(f"{drive} is being recorded: `workstation stop` ends it")
        if (folder / _KEPT).exists():
            raise RefusedError(f"{drive} is kept: `workstation recordings keep --no {drive}` first")
        try:
            shutil.rmtree(folder)
        except OSError as error:
            raise RefusedError(f"cannot remove {drive}: {error.strerror}") from None

    def _folders(self) -> list[Path]:
        try:
            found = [folder for folder in self._path.iterdir() if _number(folder.name)]
        except OSError:
            return []
        return sorted(found, key=lambda folder: _number(folder.name))

    def _removable(self, drives: list[StoredDrive]) -> Iterator[tuple[StoredDrive, StoredFile]]:
        for drive in drives:
            files = () if drive.kept else drive.files
            # The last file of the drive under way is open.
            for file in files[:-1] if drive.name == self.open_drive else files:
                yield drive, file

    def _folder(self, drive: str) -> Path:
        folder = self._path / drive
        if not _number(drive) or not folder.is_dir():
            raise RefusedError(f"no recording {drive[:40]!r} here, `workstation recordings list`")
        return folder

    @contextlib.contextmanager
    def _opened(self, drive: str, file: str) -> Generator[int]:
        folder = self._folder(drive)
        if not _FILE.fullmatch(file):
            raise RefusedError(f"file is {file[:40]!r}, expected a name such as '000.mcap'")
        try:
            descriptor = os.open(folder / file, os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW)
            try:
                yield descriptor
            finally:
                os.close(descriptor)
        except OSError as error:
            raise RefusedError(f"cannot read {drive}/{file}: {error.strerror}") from None


def _number(name: str) -> int:
    """A drive's number, from 1; 0: this is not a drive."""
    found = _DRIVE.fullmatch(name)
    return int(found[1]) if found is not None else 0


def _stored(folder: Path) -> StoredDrive | None:
    """What a folder holds; None if it goes while we look."""
    files: list[StoredFile] = []
    try:
        for path in sorted(folder.iterdir(), key=lambda path: (len(path.name), path.name)):
            if _FILE.fullmatch(path.name):
                status = path.stat()
                files.append(StoredFile(path, status.st_size, status.st_mtime_ns))
        kept = (folder / _KEPT).exists()
        date = datetime.strptime(folder.name.split("-", 2)[2], _DATE).replace(tzinfo=UTC)
    except (OSError, ValueError):
        return None
    return StoredDrive(folder.name, tuple(files), round(date.timestamp()) * 10**9, kept)
