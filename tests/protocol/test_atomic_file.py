import os
from collections.abc import Callable
from pathlib import Path

import pytest

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.files import atomic_file

from ..robot.faulty_disk import EIO, ENOSPC, FaultyDisk, State, fails_at

OLD, NEW = b"old" * 700, b"new" * 900
CALLS = ["open", "write", "write", "write", "fsync", "rename", "open", "fsync"]


@pytest.fixture(params=[OLD, None], ids=["over an old file", "a first file"])
def path(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    path = tmp_path / "file"
    if request.param is not None:
        path.write_bytes(request.param)
    return path


@pytest.fixture
def disk(path: Path, monkeypatch: pytest.MonkeyPatch) -> FaultyDisk:
    disk = FaultyDisk(path.parent)
    monkeypatch.setattr(atomic_file, "os", disk)
    return disk


def content(path: Path) -> bytes | None:
    return path.read_bytes() if path.exists() else None


def test_the_file_is_synced_before_it_gets_its_name_and_the_name_after(
    path: Path, disk: FaultyDisk
) -> None:
    atomic_file.replace(path, NEW)
    assert path.read_bytes() == NEW
    assert disk.calls == CALLS
    assert list(path.parent.iterdir()) == [path]
    assert list(disk.after_power_cut()) == [{"file": NEW}] * 3


def test_a_power_cut_at_any_call_leaves_the_old_file_or_the_new_one(
    path: Path, disk: FaultyDisk
) -> None:
    before = content(path)
    seen: list[State] = []
    disk.watch = lambda: seen.extend(disk.after_power_cut())
    atomic_file.replace(path, NEW)
    assert {state.get("file") for state in seen} == {before, NEW}


@pytest.mark.parametrize("number", range(len(CALLS)))
@pytest.mark.parametrize("code", [EIO, ENOSPC])
def test_a_call_that_fails_leaves_the_old_file_and_no_litter(
    path: Path, disk: FaultyDisk, number: int, code: int
) -> None:
    before = content(path)
    seen: list[State] = []
    disk.watch = lambda: seen.extend(disk.after_power_cut())
    disk.fault = fails_at(number, code)
    with pytest.raises(OSError, match=os.strerror(code)):
        atomic_file.replace(path, NEW)
    assert content(path) == before
    assert {state.get("file") for state in seen} <= {before, NEW}, "after a power cut meanwhile"
    assert [one for one in path.parent.iterdir() if one != path] == []


@pytest.mark.parametrize("number", range(len(CALLS)))
def test_a_disk_that_is_broken_for_good_leaves_the_old_file_or_the_new_one(
    path: Path, disk: FaultyDisk, number: int
) -> None:
    before = content(path)
    disk.fault = fails_at(number, EIO, for_good=True)
    with pytest.raises(OSError, match="Input/output"):
        atomic_file.replace(path, NEW)
    assert content(path) in (before, NEW)


# That the tests above see what they should: three ways to write a file that are not good enough.


def without_sync_of_the_file(path: Path, data: bytes, disk: FaultyDisk) -> None:
    temporary = path.with_name("file.tmp")
    file = disk.open(temporary, os.O_WRONLY | os.O_CREAT)
    disk.write(file, memoryview(data))
    disk.close(file)
    disk.rename(temporary, path)


def in_place(path: Path, data: bytes, disk: FaultyDisk) -> None:
    disk.unlink(path)
    file = disk.open(path, os.O_WRONLY | os.O_CREAT)
    disk.write(file, memoryview(data))
    disk.fsync(file)
    disk.close(file)


@pytest.mark.parametrize("way", [without_sync_of_the_file, in_place])
def test_the_disk_of_these_tests_finds_careless_writers(
    tmp_path: Path, way: Callable[[Path, bytes, FaultyDisk], None]
) -> None:
    path = tmp_path / "file"
    path.write_bytes(OLD)
    disk = FaultyDisk(tmp_path)
    seen: list[State] = []
    disk.watch = lambda: seen.extend(disk.after_power_cut())
    way(path, NEW[:900], disk)
    assert {state.get("file") for state in seen} - {OLD, NEW[:900]}


def test_what_a_person_asked_for_is_written_whole_or_not_at_all(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = content(path)

    def full(*_: object) -> int:
        raise OSError(ENOSPC, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(atomic_file.os, "write", full)
        with pytest.raises(ConfigurationError, match=f"can't write {path}: No space left"):
            atomic_file.save(path, NEW)
    assert content(path) == before
    assert [found.name for found in path.parent.iterdir()] == ["file"] * (before is not None)


def test_a_device_and_a_link_stay_what_they_are(tmp_path: Path) -> None:
    target = tmp_path / "target"
    (tmp_path / "link").symlink_to(target)
    atomic_file.save(tmp_path / "link", NEW)
    assert (tmp_path / "link").is_symlink()
    assert target.read_bytes() == NEW
    atomic_file.save(Path("/dev/null"), NEW)
    assert Path("/dev/null").is_char_device()
    with pytest.raises(ConfigurationError, match="No space left"):
        atomic_file.save(Path("/dev/full"), NEW)
