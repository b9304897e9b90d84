"""Recordings over a real link, answered by the robot's own service."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

from mbot_agent.configuration import Recording
from mbot_agent.recording.recording_directory import RecordingDirectory
from mbot_agent.recording.recording_service import RecordingService
from mbot_protocol.errors import ConfigurationError, RefusedError
from mbot_protocol.v1.recordings_pb2 import ListedDrive, RecordingList
from mbot_workstation.cli.recordings import app
from mbot_workstation.fleet.link.recording_fetch import (
    PART,
    choose,
    fetch,
    keep,
    list_recordings,
    remove,
)
from mbot_workstation.fleet.link.robot_link import RobotLink

from .fake_robot import ROBOT_ID, FakeRobot

FIRST, SECOND = bytes(range(256)) * 700, b"second" * 1000


@pytest.fixture
def card(robot: FakeRobot, tmp_path: Path) -> Path:
    """The robot's card, with one drive of two files and an empty one."""
    directory = RecordingDirectory(tmp_path / "card", Recording())
    folder = directory.new_drive()
    (folder / "000.mcap").write_bytes(FIRST)
    (folder / "001.mcap").write_bytes(SECOND)
    directory.new_drive()
    robot.replies.update(RecordingService(ROBOT_ID, directory, enabled=True).answers)
    return folder


def reads(robot: FakeRobot) -> int:
    return robot.names().count("recordings/read")


def oldest(link: RobotLink) -> ListedDrive:
    return list_recordings(link).drives[-1]


def test_a_drive_is_fetched_whole_and_a_second_time_not_sent_again(
    robot: FakeRobot, card: Path, tmp_path: Path
) -> None:
    told: list[tuple[int, int]] = []
    with RobotLink(robot.address) as link:
        folder = fetch(link, oldest(link), tmp_path / "here", lambda *both: told.append(both))
        assert folder == tmp_path / "here" / ROBOT_ID / card.name
        assert (folder / "000.mcap").read_bytes() == FIRST
        assert (folder / "001.mcap").read_bytes() == SECOND
        assert told[-1] == (len(FIRST) + len(SECOND),) * 2
        before = reads(robot)
        fetch(link, oldest(link), tmp_path / "here")
    assert reads(robot) == before == 4
    assert sorted(path.name for path in folder.iterdir()) == ["000.mcap", "001.mcap"]


def test_an_interrupted_fetch_goes_on_where_it_was(
    robot: FakeRobot, card: Path, tmp_path: Path
) -> None:
    folder = tmp_path / ROBOT_ID / card.name
    folder.mkdir(parents=True)
    (folder / f"000.mcap{PART}").write_bytes(FIRST[:150_000])
    with RobotLink(robot.address) as link:
        fetch(link, oldest(link), tmp_path)
    assert reads(robot) == 2  # the rest of the first, and the second
    assert (folder / "000.mcap").read_bytes() == FIRST


def test_a_drive_that_goes_on_is_fetched_on(robot: FakeRobot, card: Path, tmp_path: Path) -> None:
    with RobotLink(robot.address) as link:
        fetch(link, oldest(link), tmp_path)
        (card / "001.mcap").write_bytes(SECOND + b"more")
        before = reads(robot)
        folder = fetch(link, oldest(link), tmp_path)
    assert reads(robot) == before + 1
    assert (folder / "001.mcap").read_bytes() == SECOND + b"more"


def test_what_is_not_what_the_robot_has_is_thrown_away(
    robot: FakeRobot, card: Path, tmp_path: Path
) -> None:
    folder = tmp_path / ROBOT_ID / card.name
    folder.mkdir(parents=True)
    (folder / f"000.mcap{PART}").write_bytes(b"x" * 1000)
    with RobotLink(robot.address) as link:
        with pytest.raises(RefusedError, match="its digest differs"):
            fetch(link, oldest(link), tmp_path)
        assert list(folder.iterdir()) == []
        fetch(link, oldest(link), tmp_path)
    assert (folder / "000.mcap").read_bytes() == FIRST


@pytest.mark.parametrize("name", ["../../evil", "drive-1", "/etc"])
def test_a_robot_does_not_choose_where_we_write(
    robot: FakeRobot, card: Path, tmp_path: Path, name: str
) -> None:
    with RobotLink(robot.address) as link:
        drive = oldest(link)
        drive.files[0].name = "../x"
        with pytest.raises(RefusedError, match="names a file"):
            fetch(link, drive, tmp_path / "here")
        drive.name = name
        with pytest.raises(RefusedError, match="names a recording"):
            fetch(link, drive, tmp_path / "here")


def test_keeping_and_removing(robot: FakeRobot, card: Path) -> None:
    with RobotLink(robot.address) as link:
        assert keep(link, card.name, kept=True).drives[-1].kept
        with pytest.raises(RefusedError, match="is kept"):
            remove(link, card.name)
        keep(link, card.name, kept=False)
        assert len(remove(link, card.name).drives) == 1


def test_a_drive_is_chosen_by_number_name_or_last() -> None:
    names = ["drive-0012-20261122-171501", "drive-0011-20261121-100000"]
    drives = list(RecordingList(drives=[ListedDrive(name=name) for name in names]).drives)
    for wanted, index in (("last", 0), ("11", 1), ("drive-0012", 0), (names[1], 1)):
        assert choose(drives, wanted).name == names[index]
    for wanted in ("1", "drive-00", "x"):
        with pytest.raises(ConfigurationError, match="recordings fit"):
            choose(drives, wanted)
    with pytest.raises(ConfigurationError, match="the robot keeps none"):
        choose([], "last")


@pytest.fixture
def workstation(robot: FakeRobot, card: Path) -> Callable[..., str]:
    def run(*arguments: str) -> str:
        result = CliRunner().invoke(app, [*arguments, "--robot", robot.address])
        assert result.exit_code == 0, result.output
        return result.output

    return run


def test_the_commands(workstation: Callable[..., str], card: Path, tmp_path: Path) -> None:
    assert card.name in workstation("list")
    assert [drive["name"] for drive in json.loads(workstation("list", "--json"))][1] == card.name
    out = workstation("fetch", "1", "--into", str(tmp_path / "here"))
    assert out.startswith(here := str(tmp_path / "here" / ROBOT_ID / card.name))
    assert out.endswith(f"next: workstation report {here}\n")
    assert "kept" in workstation("keep", "1")
    assert "kept" not in workstation("keep", "1", "--no")
    assert card.name not in workstation("remove", "1")
    folders = json.loads(workstation("fetch", "--all", "--json", "--into", str(tmp_path)))
    assert len(folders) == 1
