"""Releases on the disk: what is whole, what is swept, and in which order that gets there."""

import os
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from mbot_protocol.files import atomic_file
from mbot_update import release_folders
from mbot_update.release_folders import ReleaseFolders

from .release_bench import Robot


@pytest.fixture
def robot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Robot:
    made = Robot(tmp_path, monkeypatch)
    made.runs("0.1")
    return made


def refused(*_: object, **__: object) -> None:
    raise OSError(28, "No space left on device")


def test_before_the_first_installation_there_is_nothing(tmp_path: Path) -> None:
    folders = ReleaseFolders(tmp_path)
    assert (folders.versions(), folders.current) == ([], "")
    assert folders.installed_s < 3600
    folders.sweep()


def test_what_is_so_already_asks_nothing_of_a_full_disk(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At every boot."""
    monkeypatch.setattr(atomic_file, "replace", refused)
    monkeypatch.setattr(release_folders.os, "symlink", refused)
    robot.folders.note(robot.folders.ledger)
    robot.folders.switch("0.1")
    with pytest.raises(OSError, match="No space"):
        robot.folders.note(replace(robot.folders.ledger, floor=7))


def test_all_of_a_release_reaches_the_disk_before_its_mark(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    marked: list[bool] = []
    monkeypatch.setattr(
        release_folders.os, "sync", lambda: marked.append(robot.folders.is_whole("0.2"))
    )
    robot.has("0.2")
    assert marked == [False]


def test_a_turned_link_has_reached_the_disk(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    robot.has("0.2")
    synced: list[tuple[Path, str]] = []
    whole = os.fsync

    def fsync(descriptor: int) -> None:
        folder = Path(f"/proc/self/fd/{descriptor}").readlink()
        synced.append((folder, robot.folders.current))
        whole(descriptor)

    monkeypatch.setattr(os, "fsync", fsync)
    before = len(list(Path("/proc/self/fd").iterdir()))
    robot.folders.switch("0.2")
    assert synced == [(robot.folders.application, "0.2")]
    assert len(list(Path("/proc/self/fd").iterdir())) == before


class Killed(BaseException):
    """Nothing after this happens."""


def test_a_broken_off_removal_leaves_nothing_that_could_run(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot.has("0.2")

    def dies(*_: object, **__: object) -> None:
        raise Killed

    monkeypatch.setattr(shutil, "rmtree", dies)
    with pytest.raises(Killed):
        robot.folders.remove("0.2")
    assert not robot.folders.is_whole("0.2")


def test_a_folder_that_can_not_be_deleted_holds_nothing_up(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot.has("0.2")
    robot.folders.incoming.mkdir()
    monkeypatch.setattr(os, "rmdir", refused)
    robot.folders.sweep()
    assert robot.folders.versions() == ["0.1"]


def test_what_a_kill_left_half_written_is_swept(robot: Robot) -> None:
    half = robot.folders.application / f"ledger.json.1.2{atomic_file.TEMPORARY}"
    half.write_bytes(b"{")
    robot.folders.sweep()
    assert not half.exists()
    assert (robot.folders.application / "ledger.json").exists()


def test_a_turn_that_was_broken_off_is_no_obstacle(robot: Robot) -> None:
    robot.has("0.2")
    (robot.folders.application / "current.new").symlink_to("releases/gone")
    robot.folders.switch("0.2")
    assert robot.folders.current == "0.2"
