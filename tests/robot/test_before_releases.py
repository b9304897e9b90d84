"""An installation of before there were releases is taken over, and comes back if need be."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from mbot_protocol.errors import RefusedError
from mbot_update import before_releases, release_folders, update_steps
from mbot_update.before_releases import take_over
from mbot_update.release_folders import BEFORE_RELEASES
from mbot_update.system import Service

from .release_bench import Robot, archive, saying

UNIT = "[Service]\nExecStart=/opt/mbot-agent/venv/bin/mbot-agent run\n"
SILENT = saying("idle")
STOPPED = Service("inactive", 0, None, "success", 0)


@pytest.fixture
def robot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Robot:
    """With a venv and a unit, no release and no link."""
    made = Robot(tmp_path / "root", monkeypatch)
    program = made.folders.application / "venv/bin/mbot-agent"
    program.parent.mkdir(parents=True)
    program.write_text("old")
    made.folders.units.mkdir(parents=True)
    (made.folders.units / "mbot-agent.service").write_text(UNIT)
    made.system.service = SILENT
    return made


def started_by(robot: Robot) -> str:
    """The text of the unit that systemd has."""
    unit = robot.folders.units / "mbot-agent.service"
    return (robot.folders.root / os.readlink(unit).lstrip("/")).read_text()  # noqa: PTH115


def installed(robot: Robot, tmp_path: Path, version: str = "0.2") -> str:
    with archive(tmp_path, version, keys=()).open("rb") as file:
        update_steps.recover(robot.folders)
        return update_steps.update(robot.folders, file).phase


def has_old(robot: Robot) -> bool:
    return (robot.folders.application / "venv/bin/mbot-agent").exists()


def test_it_is_a_release_by_another_name(robot: Robot) -> None:
    for _ in range(2):
        take_over(robot.folders)
    release = robot.folders.release(BEFORE_RELEASES)
    assert robot.folders.current == BEFORE_RELEASES
    assert (release / "venv/bin/mbot-agent").read_text() == "old"
    assert started_by(robot) == UNIT
    assert robot.system.restarted == []


def test_it_goes_when_a_release_runs_in_its_place(robot: Robot, tmp_path: Path) -> None:
    take_over(robot.folders)
    assert installed(robot, tmp_path) == "installed"
    assert robot.folders.versions() == ["0.2"]
    assert robot.folders.ledger.golden == "0.2"
    assert not has_old(robot)


def test_it_stays_until_then(robot: Robot, tmp_path: Path) -> None:
    """A daemon that does not run can't show itself."""
    robot.system.service = STOPPED
    take_over(robot.folders)
    assert installed(robot, tmp_path) == "installed"
    assert has_old(robot)
    assert robot.folders.ledger.previous == BEFORE_RELEASES
    robot.system.service = SILENT
    assert installed(robot, tmp_path, "0.3") == "installed"
    assert not has_old(robot)


def test_it_comes_back_if_the_new_one_does_not_start(robot: Robot, tmp_path: Path) -> None:
    robot.system.starts = lambda version: version == BEFORE_RELEASES
    take_over(robot.folders)
    assert installed(robot, tmp_path) == "rolled-back"
    assert robot.system.restarted == ["0.2", BEFORE_RELEASES]
    assert started_by(robot) == UNIT
    assert has_old(robot)


def test_one_that_would_not_run_changes_nothing(robot: Robot, tmp_path: Path) -> None:
    """The old one knows no `try`: that it fails, too, excuses nothing."""
    robot.system.tried = {"0.2": "no such model", BEFORE_RELEASES: "invalid choice: 'try'"}
    take_over(robot.folders)
    with pytest.raises(RefusedError, match="no such model"):
        installed(robot, tmp_path)
    assert has_old(robot)
    assert robot.system.restarted == []


def test_it_does_not_say_its_faults_so_none_is_new(robot: Robot, tmp_path: Path) -> None:
    take_over(robot.folders)
    armless = saying("fault; camera-lost")

    def restarts() -> bool:
        robot.system.service = armless
        return True

    robot.system.starts = lambda _: restarts()
    assert installed(robot, tmp_path) == "installed"


def test_a_person_goes_back_to_it(robot: Robot, tmp_path: Path) -> None:
    robot.system.service = STOPPED
    take_over(robot.folders)
    installed(robot, tmp_path)
    robot.system.tried = {BEFORE_RELEASES: "invalid choice: 'try'"}
    assert update_steps.put_back_by_hand(robot.folders).phase == "installed"
    assert started_by(robot) == UNIT


def test_one_that_would_drive_by_itself_must_be_stopped_first(robot: Robot) -> None:
    robot.folders.configuration.write_text('[control]\nstart = "running"\n')
    with pytest.raises(RefusedError, match="stop it first"):
        take_over(robot.folders)
    assert robot.folders.current == ""
    robot.system.service = STOPPED
    take_over(robot.folders)
    assert robot.folders.current == BEFORE_RELEASES


def test_what_is_left_of_a_broken_installation_is_no_release(robot: Robot) -> None:
    (robot.folders.units / "mbot-agent.service").unlink()
    take_over(robot.folders)
    assert robot.folders.current == ""
    assert not has_old(robot)


class PowerCutError(BaseException):
    """Nothing catches it."""


@pytest.mark.parametrize("name", ["symlink", "rename"])
@pytest.mark.parametrize("number", [1, 2])
def test_killed_in_between_the_old_one_starts_and_it_can_be_done_again(
    robot: Robot, monkeypatch: pytest.MonkeyPatch, name: str, number: int
) -> None:
    real: Callable[..., None] = getattr(os, name)
    calls: list[object] = []

    def dies(*arguments: object) -> None:
        if Path(str(arguments[-1])).suffix not in (".tmp",):
            calls.append(arguments)
        if len(calls) == number:
            raise PowerCutError
        real(*arguments)

    for module in (before_releases, release_folders):
        monkeypatch.setattr(module.os, name, dies)
    with pytest.raises(PowerCutError):
        take_over(robot.folders)
    monkeypatch.undo()
    monkeypatch.setattr(before_releases.system, "service", lambda: SILENT)
    monkeypatch.setattr(before_releases.system, "reload_units", lambda: None)
    unit = robot.folders.units / "mbot-agent.service"
    assert unit.is_file() or started_by(robot) == UNIT
    assert has_old(robot)
    update_steps.recover(robot.folders)  # at the next boot
    take_over(robot.folders)
    assert started_by(robot) == UNIT
    assert robot.folders.current == BEFORE_RELEASES
    assert has_old(robot)
