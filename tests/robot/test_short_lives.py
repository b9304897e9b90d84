"""A release that dies again and again, more slowly than systemd counts."""

import os
import time
from dataclasses import replace
from pathlib import Path

import pytest

from mbot_protocol.errors import RefusedError
from mbot_update import main, short_lives, system, update_steps

from .release_bench import HEALTHY, Robot, archive

HOUR_S = short_lives.SHORT_S


class Ends:
    """The daemon's ends, as its unit tells them."""

    def __init__(self, robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
        self.robot = robot
        self.put_back = 0
        self._set = monkeypatch

        def start_putting_back() -> None:
            self.put_back += 1

        monkeypatch.setattr(system, "start_putting_back", start_putting_back)

    def end(self, result: str = "signal", status: str = "SEGV", lived_s: float = 600.0) -> None:
        self._set.setenv("SERVICE_RESULT", result)
        self._set.setenv("EXIT_STATUS", status)
        self._set.setattr(system, "lived_s", lambda: lived_s)
        short_lives.count_end(self.robot.folders)

    @property
    def counted(self) -> int:
        return short_lives.short_lives(self.robot.folders)


@pytest.fixture
def robot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Robot:
    """Runs 0.2, which came after 0.1."""
    made = Robot(tmp_path / "root", monkeypatch)
    made.runs("0.1")
    made.receives(archive(tmp_path))
    assert update_steps.work(made.folders).phase == "installed"
    return made


@pytest.fixture
def ends(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> Ends:
    return Ends(robot, monkeypatch)


def test_the_tenth_young_death_puts_the_release_before_back(robot: Robot, ends: Ends) -> None:
    for number in range(9):
        ends.end()
        assert (ends.counted, ends.put_back) == (number + 1, 0)
    ends.end("watchdog", "ABRT")
    assert ends.put_back == 1
    robot.system.service = replace(HEALTHY, state="activating", result="watchdog")
    assert update_steps.is_given_up(robot.folders)
    assert update_steps.put_back_by_itself(robot.folders).phase == "rolled-back"
    assert robot.folders.current == "0.1"
    assert ends.counted == 0
    ends.end()
    assert ends.counted == 1  # of the other release


def test_one_that_a_person_puts_there_once_more_is_counted_from_nothing(
    robot: Robot, ends: Ends
) -> None:
    for _ in range(10):
        ends.end()
    update_steps.put_back_by_hand(robot.folders)
    update_steps.put_back_by_hand(robot.folders)
    assert robot.folders.current == "0.2"
    assert not short_lives.too_many(robot.folders)


def test_a_death_while_the_one_before_is_being_looked_at_counts(
    robot: Robot, ends: Ends, monkeypatch: pytest.MonkeyPatch
) -> None:
    """systemd 254 and newer starts the look after each death, and no second one beside it."""
    for _ in range(9):
        ends.end()

    def looked_at() -> system.Service:
        ends.end()
        return replace(HEALTHY, state="activating")

    monkeypatch.setattr(update_steps, "GIVES_UP_WITHIN_S", 2.0)
    monkeypatch.setattr(system, "service", looked_at)
    assert update_steps.is_given_up(robot.folders)


def test_one_that_has_lived_for_an_hour_is_not_counted_any_more(ends: Ends) -> None:
    for _ in range(9):
        ends.end()
    ends.end(lived_s=HOUR_S)
    for _ in range(20):
        ends.end(lived_s=1.0)
    assert (ends.counted, ends.put_back) == (0, 0)


@pytest.mark.parametrize(("result", "status"), [("success", "0"), ("exit-code", "2"), ("", "")])
def test_an_end_that_was_asked_for_or_is_the_configurations_is_no_death(
    ends: Ends, result: str, status: str
) -> None:
    ends.end(result, status)
    assert ends.counted == 0


def test_ends_in_an_update_and_of_the_machine_are_no_deaths(robot: Robot, ends: Ends) -> None:
    robot.folders.at_work.mkdir(parents=True)
    ends.end()
    robot.folders.at_work.rmdir()
    robot.system.up = False
    ends.end()
    assert ends.counted == 0


@pytest.mark.parametrize("damage", [b"", b"0.2", b"0.2 many", b"\xff\xfe", b"0.1 9"])
def test_a_damaged_count_starts_over(robot: Robot, ends: Ends, damage: bytes) -> None:
    robot.folders.lives.write_bytes(damage)
    ends.end()
    assert ends.counted == 1


def test_the_unit_says_it_by_the_command_line(
    robot: Robot, ends: Ends, monkeypatch: pytest.MonkeyPatch
) -> None:
    del ends
    monkeypatch.setattr(system, "lived_s", lambda: 5.0)
    monkeypatch.setattr("sys.argv", ["updater", "ended", "--root", os.fspath(robot.folders.root)])
    monkeypatch.setenv("SERVICE_RESULT", "oom-kill")
    assert main.main() == 0
    assert short_lives.short_lives(robot.folders) == 1


def test_a_death_by_the_watchdog_under_fire_is_held_against_nobody(
    robot: Robot, ends: Ends
) -> None:
    fire = robot.folders.under_fire
    fire.parent.mkdir(parents=True, exist_ok=True)
    fire.touch()
    ends.end("watchdog", "ABRT")
    assert ends.counted == 0
    ends.end("signal", "SEGV")
    assert ends.counted == 1, "a crash is one, fire or not"
    long_ago_s = time.time() - 2 * short_lives.UNDER_FIRE_S
    os.utime(fire, (long_ago_s, long_ago_s))
    ends.end("watchdog", "ABRT")
    assert ends.counted == 2


def test_what_systemd_gave_up_under_fire_is_started_again(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[str] = []
    monkeypatch.setattr(system, "start_without_waiting", lambda: started.append("started"))
    monkeypatch.setattr(
        system, "service", lambda: replace(HEALTHY, state="failed", result="watchdog")
    )
    robot.folders.under_fire.parent.mkdir(parents=True, exist_ok=True)
    robot.folders.under_fire.touch()
    with pytest.raises(RefusedError, match="flooded"):
        update_steps.put_back_by_itself(robot.folders)
    assert (robot.folders.current, started) == ("0.2", ["started"])
