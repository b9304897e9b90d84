import hashlib
import os
import time
from pathlib import Path

import pytest

from mbot_agent.recording.recording_directory import NEWEST_STAY, RecordingDirectory
from mbot_protocol.errors import RefusedError

from .recording_bench import directory


def drive(found: RecordingDirectory, *sizes: int, days_old: float = 0.0) -> Path:
    folder = found.new_drive()
    for index, size in enumerate(sizes):
        path = folder / f"{index:03d}.mcap"
        path.write_bytes(bytes(size))
        written_s = time.time() - days_old * 86_400
        os.utime(path, (written_s, written_s))
    return folder


def test_drives_are_counted_and_no_number_comes_twice(tmp_path: Path) -> None:
    found = directory(tmp_path / "recordings")
    first, second = drive(found, 10, 20), drive(found, 5)
    assert [one.name for one in found.drives()] == [first.name, second.name]
    assert first.name.startswith("drive-0001-")
    found.remove(second.name)
    assert drive(directory(tmp_path / "recordings")).name.startswith("drive-0003-")
    stored = found.drives()[0]
    assert [file.size_bytes for file in stored.files] == [10, 20]
    assert abs(stored.started_unix_time_ns - time.time_ns()) < 5e9


def test_the_oldest_go_when_there_is_too_much_and_what_is_kept_stays(tmp_path: Path) -> None:
    found = directory(tmp_path, largest_mb=16)
    drives = [drive(found, 6_000_000) for _ in range(4)]
    found.keep(drives[0].name, True)
    assert found.make_room() == ""
    assert [one.name for one in found.drives()] == [drives[0].name, drives[3].name]


def test_a_drive_under_way_loses_its_oldest_files_and_never_the_open_one(tmp_path: Path) -> None:
    found = directory(tmp_path, largest_mb=16)
    folder = drive(found, 9_000_000, 9_000_000, 9_000_000)
    found.open_drive = folder.name
    assert found.make_room() == ""
    assert [path.name for path in sorted(folder.iterdir())] == ["002.mcap"]


def test_what_is_old_goes_but_not_the_newest(tmp_path: Path) -> None:
    found = directory(tmp_path, longest_days=30)
    drives = [drive(found, 10, days_old=60) for _ in range(3)]
    drives += [drive(found, 10, days_old=20) for _ in range(NEWEST_STAY + 2)]
    found.make_room()
    assert [one.name for one in found.drives()] == [one.name for one in drives[3:]]


@pytest.mark.parametrize("days", [-40, 400])
def test_a_clock_that_is_wrong_costs_nothing_until_ten_drives_say_so(
    days: int, tmp_path: Path
) -> None:
    """Ahead or behind: no drive is old by the date of one other."""
    found = directory(tmp_path, longest_days=30)
    drives = [drive(found, 10) for _ in range(25)]
    drives += [drive(found, 10, days_old=days) for _ in range(NEWEST_STAY - 1)]
    found.make_room()
    assert len(found.drives()) == len(drives)
    drive(found, 10, days_old=days)
    found.make_room()
    assert len(found.drives()) == (NEWEST_STAY if days < 0 else len(drives) + 1)


def test_room_is_made_for_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = directory(tmp_path, leave_free_mb=100)
    drives = [drive(found, 10), drive(found, 10)]

    def usage(_: Path) -> object:
        return type("Usage", (), {"free": 150_000_000 if not drives[0].exists() else 50_000_000})

    monkeypatch.setattr("shutil.disk_usage", usage)
    assert found.make_room() == ""
    assert [one.name for one in found.drives()] == [drives[1].name]


def test_too_much_that_is_kept_is_told(tmp_path: Path) -> None:
    found = directory(tmp_path, largest_mb=16)
    found.keep(drive(found, 20_000_000).name, True)
    assert "what is kept takes 20 MB" in found.make_room()


def test_a_file_is_read_piece_by_piece_and_its_beginning_digested(tmp_path: Path) -> None:
    found = directory(tmp_path)
    folder = drive(found)
    data = bytes(range(256)) * 10
    (folder / "000.mcap").write_bytes(data)
    assert found.read(folder.name, "000.mcap", 100, 50) == data[100:150]
    assert found.read(folder.name, "000.mcap", 2550, 50) == data[2550:]
    assert found.digest(folder.name, "000.mcap", 1000) == hashlib.sha256(data[:1000]).hexdigest()
    with pytest.raises(RefusedError, match="has 2560 bytes, expected 2561"):
        found.digest(folder.name, "000.mcap", 2561)


@pytest.mark.parametrize("name", ["", "..", "../models", "drive-0001", "/etc", "drive-1-x/.."])
def test_no_name_leads_elsewhere(tmp_path: Path, name: str) -> None:
    found = directory(tmp_path)
    folder = drive(found, 10)
    for act in (found.remove, lambda one: found.keep(one, True)):
        with pytest.raises(RefusedError, match="no recording"):
            act(name)
    with pytest.raises(RefusedError):
        found.read(name, "000.mcap", 0, 1)
    for file in ("../000.mcap", "kept", "", "/etc/passwd", "1.mcap"):
        with pytest.raises(RefusedError, match="expected a name such as"):
            found.read(folder.name, file, 0, 1)
    (folder / "001.mcap").symlink_to("/etc/passwd")
    with pytest.raises(RefusedError, match="cannot read"):
        found.read(folder.name, "001.mcap", 0, 1)


def test_what_is_kept_or_being_recorded_is_not_removed(tmp_path: Path) -> None:
    found = directory(tmp_path)
    name = drive(found, 10).name
    found.keep(name, True)
    with pytest.raises(RefusedError, match=r"is kept: .*keep --no"):
        found.remove(name)
    found.keep(name, False)
    found.open_drive = name
    with pytest.raises(RefusedError, match="is being recorded"):
        found.remove(name)
    found.open_drive = ""
    found.remove(name)
    assert found.drives() == []
