"""An update, step by step: what becomes of it, and what a kill at any step leaves."""

import errno
import os
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from mbot_protocol.errors import RefusedError
from mbot_protocol.files import atomic_file
from mbot_protocol.signing.release_ledger import BUSY, Ledger, Outcome
from mbot_update import release_folders, short_lives, system, taking_in, update_steps
from mbot_update.release_folders import BEFORE_RELEASES, ReleaseFolders

from .release_bench import HEALTHY, SPARE, Robot, archive, saying


class Killed(BaseException):
    """Nothing after this happens."""


class DyingOs:
    """`os`, whose calls that change the disk are counted; the process is killed before one."""

    CHANGING = ("open", "write", "fsync", "rename", "unlink", "symlink", "sync")

    def __init__(self) -> None:
        self.calls = 0
        self.last = -1

    def count(self, _: str = "") -> None:
        if self.calls == self.last:
            raise Killed
        self.calls += 1

    def __getattr__(self, name: str) -> object:
        found = getattr(os, name)
        if name not in self.CHANGING:
            return found

        def counted(*arguments: object, **named: object) -> object:
            self.count()
            return found(*arguments, **named)

        return counted


@pytest.fixture
def robot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Robot:
    made = Robot(tmp_path / "root", monkeypatch)
    made.runs("0.1")
    return made


def test_a_good_release_takes_the_place_of_the_old_one(robot: Robot, tmp_path: Path) -> None:
    robot.receives(archive(tmp_path))
    outcome = update_steps.work(robot.folders)
    assert (outcome.request, outcome.phase) == ("a1", "installed")
    ledger = robot.folders.ledger
    assert robot.folders.current == "0.2"
    assert (ledger.previous, ledger.golden, ledger.floor) == ("0.1", "0.1", 2)
    assert robot.system.restarted == ["0.2"]
    assert list(robot.folders.inbox.iterdir()) == []
    assert not robot.folders.incoming.exists()


def test_what_a_power_cut_has_cut_off_is_given_up_and_said(robot: Robot, tmp_path: Path) -> None:
    robot.receives(archive(tmp_path))
    busy = replace(robot.folders.ledger.outcome, request="a1", phase="checking")
    robot.folders.note(replace(robot.folders.ledger, outcome=busy))
    outcome = update_steps.work(robot.folders)
    assert (outcome.request, outcome.phase) == ("a1", "failed")
    assert "interrupted while checking; 0.1 runs: try again" in outcome.detail
    assert update_steps.work(robot.folders) == outcome
    assert list(robot.folders.inbox.iterdir()) == []


def test_a_shutdown_in_mid_trial_is_not_held_against_the_release(
    robot: Robot, tmp_path: Path
) -> None:
    robot.system.starts, robot.system.up = lambda _: False, False
    robot.receives(archive(tmp_path))
    with pytest.raises(system.GoingDownError):
        update_steps.work(robot.folders)
    update_steps.recover(robot.folders)
    assert robot.folders.current == "0.1"
    assert robot.folders.ledger.rejected == {}
    assert robot.folders.ledger.outcome.phase == "failed"


def test_the_spare_key_is_as_good(robot: Robot, tmp_path: Path) -> None:
    robot.receives(archive(tmp_path, keys=(SPARE,)))
    assert update_steps.work(robot.folders).phase == "installed"


def test_one_that_gets_no_ready_is_rolled_back_and_refused_from_then_on(
    robot: Robot, tmp_path: Path
) -> None:
    robot.system.starts = lambda version: version == "0.1"
    robot.receives(archive(tmp_path))
    outcome = update_steps.work(robot.folders)
    assert outcome.phase == "rolled-back"
    assert outcome.detail == "it did not get READY; 0.1 runs again"
    assert robot.folders.current == "0.1"
    assert robot.folders.versions() == ["0.1"]
    assert robot.system.restarted == ["0.2", "0.1"]
    robot.receives(archive(tmp_path))
    again = update_steps.work(robot.folders)
    assert again.phase == "refused"
    assert "rolled back on this robot before: it did not get READY" in again.detail


def test_a_camera_that_the_new_one_does_not_see_rolls_it_back(
    robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = iter([HEALTHY])
    worse = saying("idle; no-model camera-lost")
    monkeypatch.setattr(update_steps.system, "service", lambda: next(seen, worse))
    robot.receives(archive(tmp_path))
    outcome = update_steps.work(robot.folders)
    assert outcome.phase == "rolled-back"
    assert "worse than before: camera-lost" in outcome.detail


@pytest.mark.parametrize("words", ["idle; camera-lost board-lost", "fault; link-lost"])
def test_what_was_missing_before_is_not_held_against_it(
    robot: Robot, tmp_path: Path, words: str
) -> None:
    robot.system.service = saying(words)
    robot.receives(archive(tmp_path))
    expected = "refused" if words.startswith("fault") else "installed"  # armed: not now
    assert update_steps.work(robot.folders).phase == expected


def test_one_that_fails_beside_the_running_one_never_replaces_it(
    robot: Robot, tmp_path: Path
) -> None:
    robot.system.tried = {"0.2": "no module named zenoh"}
    robot.receives(archive(tmp_path))
    outcome = update_steps.work(robot.folders)
    assert outcome.phase == "refused"
    assert "0.2 does not run here: no module named zenoh" in outcome.detail
    assert robot.system.restarted == []
    assert robot.folders.current == "0.1"
    assert robot.folders.versions() == ["0.1"]


def test_a_broken_configuration_is_not_held_against_it(robot: Robot, tmp_path: Path) -> None:
    robot.system.tried = {"0.1": "config.toml is wrong", "0.2": "config.toml is wrong"}
    robot.receives(archive(tmp_path))
    assert update_steps.work(robot.folders).phase == "installed"


def test_golden_current_and_previous_stay_and_no_others(robot: Robot, tmp_path: Path) -> None:
    for number in (2, 3, 4):
        robot.receives(archive(tmp_path, f"0.{number}", number))
        assert update_steps.work(robot.folders).phase == "installed"
    assert robot.folders.versions() == ["0.1", "0.3", "0.4"]


def test_a_daemon_that_does_not_run_is_not_started(robot: Robot, tmp_path: Path) -> None:
    robot.system.service = replace(HEALTHY, state="inactive", pid=0, report=None)
    with archive(tmp_path).open("rb") as file:
        assert update_steps.update(robot.folders, file).phase == "installed"
    assert robot.system.restarted == []


def test_a_release_that_dies_later_goes_back_once_and_further_to_the_golden_one(
    robot: Robot, tmp_path: Path
) -> None:
    for number in (2, 3):
        robot.receives(archive(tmp_path, f"0.{number}", number))
        update_steps.work(robot.folders)
    robot.system.service = replace(HEALTHY, state="failed", result="exit-code", exit_status=1)
    assert update_steps.put_back_by_itself(robot.folders).phase == "rolled-back"
    assert robot.folders.current == "0.2"
    assert "0.3" in robot.folders.ledger.rejected
    update_steps.put_back_by_itself(robot.folders)
    assert robot.folders.current == "0.1"
    with pytest.raises(RefusedError, match="no other release"):
        update_steps.put_back_by_itself(robot.folders)


def test_a_wrong_configuration_puts_nothing_back(robot: Robot, tmp_path: Path) -> None:
    robot.receives(archive(tmp_path))
    update_steps.work(robot.folders)
    robot.system.service = replace(HEALTHY, state="failed", result="exit-code", exit_status=2)
    with pytest.raises(RefusedError, match="configuration"):
        update_steps.put_back_by_itself(robot.folders)
    assert robot.folders.current == "0.2"


def test_a_person_goes_back_and_forth(robot: Robot, tmp_path: Path) -> None:
    robot.receives(archive(tmp_path))
    update_steps.work(robot.folders)
    robot.folders.lives.write_text("0.2 9\n")
    update_steps.put_back_by_hand(robot.folders)
    assert robot.folders.current == "0.1"
    update_steps.put_back_by_hand(robot.folders)
    assert robot.folders.current == "0.2"
    assert short_lives.short_lives(robot.folders) == 0, "it has another nine lives"


@pytest.mark.parametrize(("state", "previous"), [("active", ""), ("inactive", BEFORE_RELEASES)])
def test_one_of_before_releases_goes_once_another_has_shown_itself_in_its_place(
    robot: Robot, tmp_path: Path, state: str, previous: str
) -> None:
    robot.has(BEFORE_RELEASES)
    robot.folders.switch(BEFORE_RELEASES)
    robot.system.service = replace(HEALTHY, state=state)
    with archive(tmp_path).open("rb") as file:
        outcome = update_steps.update(robot.folders, file)
    assert outcome.detail == ("0.2 runs" if state == "active" else "0.2")
    assert robot.folders.ledger.previous == previous
    assert robot.folders.is_whole(BEFORE_RELEASES) == bool(previous)


def test_a_request_that_nobody_can_read_is_refused_and_gone(robot: Robot) -> None:
    os.mkfifo(robot.folders.inbox / "request")
    outcome = update_steps.work(robot.folders)
    assert (outcome.request, outcome.phase) == ("", "refused")
    assert list(robot.folders.inbox.iterdir()) == []


@pytest.mark.parametrize("fate", ["good", "mute"])
def test_killed_at_any_step_a_whole_release_runs_and_the_next_update_works(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fate: str
) -> None:
    new, third = archive(tmp_path), archive(tmp_path, "0.3", 3)
    found: set[tuple[str, str]] = set()
    number = 0
    while True:
        with monkeypatch.context() as patched:
            robot = Robot(tmp_path / f"root-{number}", patched)
            robot.runs("0.1")
            if fate == "mute":
                robot.system.starts = lambda version: version != "0.2"
            robot.receives(new)
            dying = DyingOs()
            dying.last = number
            robot.system.before = dying.count
            was_killed = False
            with monkeypatch.context() as dangerous:
                for module in (atomic_file, release_folders, taking_in):
                    dangerous.setattr(module, "os", dying)
                try:
                    update_steps.work(robot.folders)
                except Killed:
                    was_killed = True
            robot.system.before = lambda _: None
            between = robot.folders.current
            assert robot.folders.is_whole(between), number
            _recovered(robot, found)
            # What was known to be bad never runs; what goes on can be updated.
            if fate == "mute":
                assert robot.folders.current == "0.1", number
            robot.receives(third, "b2")
            assert update_steps.work(robot.folders).phase == "installed", number
            assert robot.folders.current == "0.3"
        if not was_killed:
            break
        number += 1
    assert number > 40
    ends = {"good": {("0.1", "failed"), ("0.2", "installed")}}
    assert found >= ends.get(fate, {("0.1", "failed"), ("0.1", "rolled-back")})


def _recovered(robot: Robot, found: set[tuple[str, str]]) -> None:
    folders = robot.folders
    update_steps.recover(folders)
    ledger = folders.ledger
    assert ledger.came_from == ""
    assert ledger.outcome.phase not in BUSY
    assert folders.is_whole(folders.current)
    assert folders.current in ("0.1", "0.2")
    assert (ledger.floor == 2) == (folders.current == "0.2")
    assert set(folders.versions()) <= {"0.1", "0.2"}
    assert not folders.incoming.exists()
    assert sorted(p.name for p in (folders.application / "releases").iterdir()) == (
        folders.versions()
    )
    found.add((folders.current, ledger.outcome.phase))


@pytest.mark.parametrize("state", ["activating", "active", "inactive"])
@pytest.mark.parametrize("failed_after_s", [0.0, 2.0, 60.0])
def test_a_daemon_that_is_about_to_be_started_again_is_not_put_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, state: str, failed_after_s: float
) -> None:
    """systemd 254 and newer ask after every death."""
    Robot(tmp_path, monkeypatch)
    now_s = 1000.0

    def sleep(time_s: float) -> None:
        nonlocal now_s
        now_s += time_s

    def service() -> system.Service:
        return replace(HEALTHY, state="failed" if now_s - 1000.0 >= failed_after_s else state)

    clock = SimpleNamespace(monotonic=lambda: now_s, sleep=sleep)
    monkeypatch.setattr(update_steps, "time", clock)
    monkeypatch.setattr(system, "service", service)
    given_up = update_steps.is_given_up(ReleaseFolders(tmp_path))
    assert given_up == (failed_after_s < update_steps.GIVES_UP_WITHIN_S)
    assert now_s - 1000.0 >= min(failed_after_s, update_steps.GIVES_UP_WITHIN_S)
    assert now_s - 1000.0 < update_steps.GIVES_UP_WITHIN_S + 2.0


class Diary:
    """All that happens: notes in the ledger, turns of the link, what is asked of systemd."""

    def __init__(self, robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
        self.outcomes: list[Outcome] = []
        self.steps: list[str] = []
        folders = robot.folders
        whole_note, whole_switch = folders.note, folders.switch

        def note(ledger: Ledger) -> None:
            whole_note(ledger)
            self.steps.append(f"notes {ledger.came_from or 'nothing'}")
            if ledger.outcome not in self.outcomes:
                self.outcomes.append(ledger.outcome)

        def switch(version: str) -> None:
            whole_switch(version)
            self.steps.append(f"turns to {version}")

        monkeypatch.setattr(folders, "note", note)
        monkeypatch.setattr(folders, "switch", switch)
        robot.system.before = self.steps.append


def test_each_phase_is_noted_for_whoever_watches(
    robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    diary = Diary(robot, monkeypatch)
    robot.receives(archive(tmp_path))
    update_steps.work(robot.folders)
    assert diary.outcomes == [
        Outcome(),
        Outcome("a1", "", "checking", "checking"),
        Outcome("a1", "0.2", "building", "building 0.2"),
        Outcome("a1", "0.2", "trying", "0.2 instead of 0.1"),
        Outcome("a1", "0.2", "installed", "0.2 runs"),
    ]
    robot.receives(archive(tmp_path, "0.3", 1), "b2")
    refused = update_steps.work(robot.folders)
    assert (refused.request, refused.phase) == ("b2", "refused")
    assert robot.folders.ledger.outcome == refused


@pytest.mark.parametrize("good", [True, False])
def test_where_it_came_from_is_noted_before_the_link_is_turned(
    robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, good: bool
) -> None:
    """And systemd has read the unit before the daemon is started by it, in both directions."""
    robot.system.starts = lambda version: good or version == "0.1"
    diary = Diary(robot, monkeypatch)
    robot.receives(archive(tmp_path))
    update_steps.work(robot.folders)
    trial = diary.steps[diary.steps.index("try") + 1 :]
    there = ["notes 0.1", "turns to 0.2", "systemctl", "restart"]
    back = [] if good else ["turns to 0.1", "systemctl", "restart"]
    assert trial == [*there, *back, "notes nothing"]


def test_the_one_that_runs_may_be_installed_again_by_hand(robot: Robot, tmp_path: Path) -> None:
    """What was held against it is forgotten, and it is not even restarted."""
    robot.receives(archive(tmp_path))
    update_steps.work(robot.folders)
    robot.folders.lives.write_text("0.2 9\n")
    robot.folders.note(robot.folders.ledger.with_rejected("0.2", "died"))
    robot.system.restarted.clear()
    with archive(tmp_path).open("rb") as file:
        outcome = update_steps.update(robot.folders, file)
    assert outcome == Outcome("", "0.2", "installed", "0.2")
    ledger = robot.folders.ledger
    assert (ledger.outcome, ledger.rejected, ledger.previous) == (outcome, {}, "0.1")
    assert (robot.folders.current, robot.system.restarted) == ("0.2", [])
    assert short_lives.short_lives(robot.folders) == 0


def test_the_first_one_is_not_compared_with_any(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot = Robot(tmp_path / "root", monkeypatch)
    robot.folders.application.mkdir(parents=True)
    robot.system.service = replace(HEALTHY, state="inactive", pid=0, report=None)
    with archive(tmp_path).open("rb") as file:
        assert update_steps.update(robot.folders, file).phase == "installed"
    ledger = robot.folders.ledger
    assert (robot.folders.current, ledger.golden, ledger.previous) == ("0.2", "0.2", "")
    assert robot.system.restarted == []


@pytest.mark.parametrize("current", ["0.1", "0.2"])
@pytest.mark.parametrize("state", ["active", "inactive", ""])
def test_a_boot_goes_back_from_what_nobody_accepted_and_wakes_nobody(
    robot: Robot, monkeypatch: pytest.MonkeyPatch, current: str, state: str
) -> None:
    robot.has("0.2")
    robot.folders.switch(current)
    robot.folders.note(replace(robot.folders.ledger, came_from="0.1"))
    robot.system.service = replace(HEALTHY, state=state)
    diary = Diary(robot, monkeypatch)
    update_steps.recover(robot.folders)
    assert (robot.folders.current, robot.folders.ledger.came_from) == ("0.1", "")
    read_again = ["systemctl"] if current == "0.2" else []
    restarted = ["restart"] if current == "0.2" and state == "active" else []
    assert diary.steps == ["turns to 0.1", "notes nothing", *read_again, *restarted]


def test_a_boot_on_a_full_disk_needs_no_note_where_nothing_went_on(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    FullDisk(monkeypatch).full = True
    update_steps.recover(robot.folders)
    assert robot.system.restarted == []


def test_a_person_goes_back_from_the_last_one_that_was_accepted(
    robot: Robot, tmp_path: Path
) -> None:
    """Not from one whose trial was broken off: that would become the one to go back to."""
    robot.receives(archive(tmp_path))
    update_steps.work(robot.folders)
    robot.has("0.3")
    robot.folders.switch("0.3")
    robot.folders.note(replace(robot.folders.ledger, came_from="0.2"))
    update_steps.put_back_by_hand(robot.folders)
    assert (robot.folders.current, robot.folders.ledger.previous) == ("0.1", "0.2")


def test_an_old_one_that_does_not_get_ready_either_is_said(robot: Robot, tmp_path: Path) -> None:
    robot.system.starts = lambda _: False
    robot.receives(archive(tmp_path))
    outcome = update_steps.work(robot.folders)
    assert outcome.version == "0.2"
    assert outcome.detail == "it did not get READY; 0.1 is back, but not READY"
    assert robot.folders.ledger.outcome == outcome


def dies_later(robot: Robot) -> None:
    robot.system.service = replace(HEALTHY, state="failed", result="exit-code", exit_status=1)


def test_what_died_later_is_swept_and_named(
    robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot.receives(archive(tmp_path))
    update_steps.work(robot.folders)
    dies_later(robot)
    diary = Diary(robot, monkeypatch)
    outcome = update_steps.put_back_by_itself(robot.folders)
    assert (outcome.request, outcome.version, outcome.phase) == ("", "0.2", "rolled-back")
    assert outcome.detail == f"{update_steps.DIED}: 0.1 runs"
    ledger = robot.folders.ledger
    assert (ledger.outcome, ledger.previous, ledger.golden) == (outcome, "", "0.1")
    assert robot.folders.versions() == ["0.1"]
    assert diary.steps == ["notes 0.1", "turns to 0.1", "systemctl", "restart", "notes nothing"]


def test_what_a_person_may_still_go_back_to_stays_when_the_golden_one_is_put_back(
    robot: Robot, tmp_path: Path
) -> None:
    for number in (2, 3):
        robot.receives(archive(tmp_path, f"0.{number}", number))
        update_steps.work(robot.folders)
    robot.folders.note(robot.folders.ledger.with_rejected("0.2", "died"))
    dies_later(robot)
    update_steps.put_back_by_itself(robot.folders)
    assert (robot.folders.current, robot.folders.ledger.previous) == ("0.1", "0.2")
    assert robot.folders.is_whole("0.2")


def test_killed_at_any_step_of_putting_back_the_dead_one_is_not_taken_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    new, number, was_killed = archive(tmp_path), 0, True
    while was_killed:
        with monkeypatch.context() as patched:
            robot = Robot(tmp_path / f"root-{number}", patched)
            robot.runs("0.1")
            robot.receives(new)
            update_steps.work(robot.folders)
            dies_later(robot)
            dying = DyingOs()
            dying.last = number
            robot.system.before = dying.count
            was_killed = False
            with monkeypatch.context() as dangerous:
                for module in (atomic_file, release_folders):
                    dangerous.setattr(module, "os", dying)
                try:
                    update_steps.put_back_by_itself(robot.folders)
                except Killed:
                    was_killed = True
            robot.system.before = lambda _: None
            turned = robot.folders.current == "0.1"
            update_steps.recover(robot.folders)
            went_back = robot.folders.current == "0.1"
            assert went_back or not turned, number
            assert ("0.2" in robot.folders.ledger.rejected) == went_back, number
            assert robot.folders.ledger.came_from == ""
        number += 1
    assert number > 10


class FullDisk:
    """Takes no note any more, from when it is told so, or while what fills it is there."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, filled_by: Path = Path("/")) -> None:
        self.full = False
        whole = atomic_file.replace

        def replace_if_room(path: Path, data: bytes, *, mode: int = 0o666) -> None:
            if self.full and filled_by.exists() and path.name == "ledger.json":
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            whole(path, data, mode=mode)

        monkeypatch.setattr(atomic_file, "replace", replace_if_room)


@pytest.mark.parametrize("good", [True, False])
def test_a_disk_that_fills_up_during_a_trial_leaves_the_old_release_running(
    robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, good: bool
) -> None:
    disk = FullDisk(monkeypatch)

    def fill(step: str) -> None:
        disk.full |= step == "restart"

    robot.system.before = fill
    robot.system.starts = lambda version: good or version == "0.1"
    robot.receives(archive(tmp_path))
    outcome = update_steps.work(robot.folders)
    assert robot.system.restarted == ["0.2", "0.1"]
    assert (robot.folders.current, outcome.phase) == ("0.1", "rolled-back")
    assert robot.folders.ledger.came_from == "0.1", "whoever finds it goes back once more"
    disk.full = False
    update_steps.recover(robot.folders)
    assert (robot.folders.current, robot.folders.ledger.came_from) == ("0.1", "")


def test_what_fills_the_disk_goes_before_that_is_noted(
    robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    disk = FullDisk(monkeypatch, robot.folders.release("0.2"))

    def fill(step: str) -> None:
        disk.full |= step == "restart"

    robot.system.before = fill
    robot.receives(archive(tmp_path))
    assert update_steps.work(robot.folders).phase == "rolled-back"
    ledger = robot.folders.ledger
    assert (ledger.came_from, ledger.outcome.phase) == ("", "rolled-back")
    assert "the disk takes no note of it" in ledger.rejected["0.2"]


def test_a_full_disk_keeps_no_dead_release_from_going_back(
    robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot.receives(archive(tmp_path))
    assert update_steps.work(robot.folders).phase == "installed"
    FullDisk(monkeypatch).full = True
    update_steps.put_back_by_itself(robot.folders)
    assert (robot.folders.current, robot.system.restarted[-1]) == ("0.1", "0.1")
