"""Driving maneuvers: planned in rounds, told without a gap, kept whole, stopped at a touch."""

import json
import os
import pty
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from mbot_protocol.drive.actions import MotorMap, WheelMaps
from mbot_protocol.errors import ConfigurationError, RefusedError, UnreachableError
from mbot_protocol.v1.messages_pb2 import Command, CommandReply, Fault, State
from mbot_protocol.wire.keys import COMMAND, STATUS, STOP
from mbot_workstation.cli.maneuvers import app
from mbot_workstation.fleet.link import remote_control
from mbot_workstation.fleet.link.remote_control import RemoteControl
from mbot_workstation.fleet.link.robot_link import RobotLink
from mbot_workstation.measure.maneuvers.maneuver_drive import (
    HOLD_MS,
    DrivenCommands,
    SpoiltRunError,
    drive_maneuver,
    measure_robot_time,
)
from mbot_workstation.measure.maneuvers.maneuver_session import (
    Session,
    SessionSettings,
    check_ready,
)
from mbot_workstation.measure.maneuvers.plan import Order, Planned, plan, reach, room_needed_m
from mbot_workstation.measure.maneuvers.session_journal import Journal
from mbot_workstation.measure.maneuvers.terminal import Keyboard, NoKeys, PlainDisplay
from mbot_workstation.measure.tracks.commands_csv import read_commands
from mbot_workstation.measure.tracks.maneuver import MANEUVERS, maneuver_named
from mbot_workstation.measure.tracks.recording_toml import read_info

from ..ran import LIMIT_S, WORKSTATION, ran, without_robot
from ..until import until
from .fake_robot import CLOCK_AHEAD_NS, FakeRobot

# Plan


@given(
    st.sets(st.sampled_from(MANEUVERS)), st.integers(1, 5), st.sampled_from(Order), st.integers()
)
def test_every_order_drives_everything_once_a_round(maneuvers, repetitions, order, seed) -> None:
    runs = plan(tuple(maneuvers), repetitions, order, seed)
    assert len(runs) == len(maneuvers) * repetitions
    for repetition in range(repetitions):
        one_round = runs[repetition * len(maneuvers) : (repetition + 1) * len(maneuvers)]
        assert {run.maneuver for run in one_round} == maneuvers
        assert {run.repetition for run in one_round} <= {repetition + 1}


def test_paired_runs_bring_the_robot_back() -> None:
    runs = plan(MANEUVERS, 1, Order.PAIRED)
    for first, second in zip(runs[::2], runs[1::2], strict=True):
        assert (first.maneuver.left, first.maneuver.right) == (
            (-second.maneuver.left, -second.maneuver.right)
        )


def test_shuffling_is_repeatable() -> None:
    assert plan(MANEUVERS, 3, Order.SHUFFLED, 1) == plan(MANEUVERS, 3, Order.SHUFFLED, 1)
    assert plan(MANEUVERS, 3, Order.SHUFFLED, 1) != plan(MANEUVERS, 3, Order.SHUFFLED, 2)


def test_room_for_ten_seconds_ahead_is_more_than_four_metres() -> None:
    assert 4.1 < room_needed_m(maneuver_named("forward-forward"), 10)[0] < 6
    assert room_needed_m(maneuver_named("forward-backward"), 10)[0] < 0.5


# Telling


def test_the_robots_time_is_known_within_what_is_said(link: RobotLink) -> None:
    clock = measure_robot_time(link)
    assert abs(clock.ahead_ns - CLOCK_AHEAD_NS) <= clock.uncertainty_ns
    assert clock.uncertainty_ns < 1e9
    assert clock.robot_s(2_000_000_000) == pytest.approx(2 + CLOCK_AHEAD_NS / 1e9, abs=1)


def driven(link: RobotLink, name: str, seconds: float, interrupted=lambda: False) -> DrivenCommands:
    control = RemoteControl(link)
    control.synchronise()
    clock = measure_robot_time(link)
    return drive_maneuver(control, clock, maneuver_named(name), seconds, interrupted)


def drives(robot: FakeRobot) -> list[Command]:
    return [command for command in robot.commands() if command.WhichOneof("action") == "drive"]


def test_a_maneuver_is_held_and_then_stopped(robot: FakeRobot, link: RobotLink) -> None:
    before_s = robot.now_ns() / 1e9
    result = driven(link, "forward-backward", 1.2)
    told = result.series
    assert told.end_s - told.start_s == pytest.approx(1.2, abs=0.1)
    assert before_s < told.start_s < robot.now_ns() / 1e9
    assert told.left.tolist() == [0, 1, 0]
    assert told.right.tolist() == [0, -1, 0]
    assert len(drives(robot)) >= 3
    for command in drives(robot):
        assert (command.drive.wheels.left, command.drive.wheels.right) == (1, -1)
        assert 0 < command.drive.hold_ms <= HOLD_MS
    assert robot.names()[-1] == STOP.name


@pytest.mark.parametrize("seconds", [0.3, 0.5, 0.9])
def test_the_last_command_expires_when_the_drive_ends(
    robot: FakeRobot, link: RobotLink, seconds: float
) -> None:
    """So that it ends in time even if the link dies just then."""
    arrived: list[tuple[int, int]] = []
    answer = robot.replies[COMMAND.name]

    def noted(data: bytes):
        arrived.append((robot.now_ns(), Command.FromString(data).drive.hold_ms))
        return answer(data)

    robot.replies[COMMAND.name] = noted
    told = driven(link, "forward-forward", seconds).series
    at_ns, hold_ms = arrived[-1]
    assert at_ns / 1e9 + hold_ms / 1000 == pytest.approx(told.end_s, abs=0.1)
    for (first_ns, hold_ms), (second_ns, _) in pairwise(arrived):
        assert second_ns - first_ns < hold_ms * 1e6


def test_an_interrupted_drive_stops_and_is_spoilt(robot: FakeRobot, link: RobotLink) -> None:
    looks = iter([False, False, True])
    with pytest.raises(SpoiltRunError, match="stopped by hand"):
        driven(link, "forward-forward", 20, lambda: next(looks))
    assert robot.names()[-1] == STOP.name


def test_a_refusal_in_mid_drive_spoils_the_run(robot: FakeRobot, link: RobotLink) -> None:
    answer, count = robot.replies[COMMAND.name], iter(range(100))
    robot.replies[COMMAND.name] = lambda data: (
        CommandReply(schema_version=1, reason="board lost") if next(count) == 2 else answer(data)
    )
    with pytest.raises(SpoiltRunError, match="board lost"):
        driven(link, "forward-forward", 20)
    assert robot.names()[-1] == STOP.name


def test_a_link_that_hangs_for_too_long_spoils_the_run(robot: FakeRobot, link: RobotLink) -> None:
    answer, count = robot.replies[COMMAND.name], iter(range(100))

    def slow(data: bytes):
        if next(count) == 2:
            time.sleep(HOLD_MS / 1000 + 0.1)
        return answer(data)

    robot.replies[COMMAND.name] = slow
    with pytest.raises(SpoiltRunError, match=r"the link was too slow|came too late"):
        driven(link, "forward-forward", 20)


def test_a_robot_that_cannot_be_driven_is_refused(robot: FakeRobot, link: RobotLink) -> None:
    check_ready(link)
    status = robot.status()
    robot.replies[STATUS.name] = lambda _data: status
    status.faults.append(Fault(kind="camera-stalled", detail="no matter"))
    check_ready(link)
    status.faults.append(Fault(kind="board-lost", detail="no board"))
    with pytest.raises(RefusedError, match="can't drive: board-lost: no board"):
        check_ready(link)
    status.state = State.STATE_RUNNING
    with pytest.raises(RefusedError, match="a policy is driving"):
        check_ready(link)


# Journal


def journal_in(folder: Path) -> Journal:
    return Journal.create(folder, "mbot-1", WheelMaps(), "2026-11-21", 1_700_000_000.0)


def kept(journal: Journal) -> list[int]:
    return [run.number for run in read_commands(journal.folder / "commands.csv")]


def add(journal: Journal, link: RobotLink, index: int, repetition: int = 1) -> None:
    commands = driven(link, MANEUVERS[index].name, 0.3)
    number = journal.next_number()
    journal.add(number, MANEUVERS[index], repetition, commands.series, commands.uncertainty_s)


def test_a_journal_is_whole_after_every_run(tmp_path: Path, link: RobotLink) -> None:
    maps = WheelMaps(MotorMap(True, 0.9, 45), MotorMap(False))
    journal = Journal.create(tmp_path / "rec", "mbot-1", maps, "2026-11-21", 1.7e9)
    add(journal, link, 0)
    assert kept(journal) == [1]
    add(journal, link, 1)
    assert kept(journal) == [1, 2]
    info = read_info(journal.folder)
    assert (info.robot_id, info.made_on, info.wheel_maps) == ("mbot-1", "2026-11-21", maps)
    assert info.clock_began_unix_s == 1.7e9
    assert info.clock_uncertainty_ms > 0
    assert sorted(path.name for path in journal.folder.iterdir()) == [
        "commands.csv",
        "recording.toml",
    ]


def test_a_spoilt_run_is_forgotten_and_its_number_not_used_again(
    tmp_path: Path, link: RobotLink
) -> None:
    journal = journal_in(tmp_path / "rec")
    assert journal.remove_last() is None
    add(journal, link, 0)
    add(journal, link, 1)
    removed = journal.remove_last()
    assert removed is not None
    assert removed.maneuver == MANEUVERS[1].name
    add(journal, link, 1)
    assert kept(journal) == [1, 3]


def test_a_recording_is_resumed(tmp_path: Path, link: RobotLink) -> None:
    journal = journal_in(tmp_path / "rec")
    again = Journal.resume(tmp_path / "rec", "mbot-1", 1_700_000_010.0)
    assert again.runs == []
    add(journal, link, 0)
    again = Journal.resume(tmp_path / "rec", "mbot-1", 1_700_000_010.0)
    assert again.recorded == {("forward-forward", 1)}
    add(again, link, 1)
    assert kept(again) == [1, 2]


def test_what_does_not_belong_together_is_not_resumed(tmp_path: Path) -> None:
    journal_in(tmp_path / "rec")
    with pytest.raises(ConfigurationError, match="go on with it by --resume"):
        journal_in(tmp_path / "rec")
    with pytest.raises(ConfigurationError, match="a recording of mbot-1, this robot is mbot-2"):
        Journal.resume(tmp_path / "rec", "mbot-2", 1_700_000_000.0)
    with pytest.raises(ConfigurationError, match="the robot has been restarted since"):
        Journal.resume(tmp_path / "rec", "mbot-1", 1_700_009_000.0)
    with pytest.raises(ConfigurationError, match="is not a recording"):
        Journal.resume(tmp_path, "mbot-1", 0)


# Session


@dataclass
class Script(PlainDisplay, NoKeys):
    """Keys that are pressed at certain lines of the display, and what it said."""

    presses: dict[str, list[str]] = field(default_factory=dict)
    waiting: list[str] = field(default_factory=list)
    heard: list[str] = field(default_factory=list)

    def pressed(self) -> str | None:
        return self.waiting.pop(0) if self.waiting else None

    def hear(self, text: str) -> None:
        self.heard.append(text)
        for start in list(self.presses):
            if text.startswith(start):
                self.waiting += self.presses.pop(start)

    def next_run(self, run: Planned, done: int, total: int) -> None:
        self.hear(f"next {run.maneuver.name} {run.repetition} {done}/{total}")

    def driving(self) -> None:
        self.hear("driving")

    def recorded(self, run: Planned, number: int) -> None:
        self.hear(f"recorded {number}")

    def say(self, text: str) -> None:
        self.hear(f"say {text}")


def session(
    link: RobotLink,
    journal: Journal,
    script: Script,
    *,
    attended: bool = True,
    repetitions: int = 1,
) -> Session:
    runs = plan(MANEUVERS[:2], repetitions, Order.LISTED)
    return Session(link, journal, runs, SessionSettings(0.3, 0.1, attended), script, script)


def test_a_session_drives_all_and_keeps_it(tmp_path: Path, link: RobotLink) -> None:
    journal, script = journal_in(tmp_path / "rec"), Script()
    assert session(link, journal, script, repetitions=2).run()
    assert kept(journal) == [1, 2, 3, 4]
    assert script.heard[:4] == [
        "next forward-forward 1 0/4",
        "driving",
        "recorded 1",
        "next forward-neutral 1 1/4",
    ]
    # All is there: nothing is left to drive.
    assert session(link, journal, Script(), repetitions=2).run()
    assert kept(journal) == [1, 2, 3, 4]


def test_a_key_during_a_drive_stops_it_and_it_is_driven_again(
    tmp_path: Path, robot: FakeRobot, link: RobotLink
) -> None:
    journal, script = journal_in(tmp_path / "rec"), Script({"driving": ["x"], "say forward": ["p"]})
    assert session(link, journal, script).run()
    assert "say forward-forward, repetition 1 was spoilt and is not kept: stopped by hand" in (
        script.heard
    )
    assert kept(journal) == [2, 3]
    assert robot.names().count(STOP.name) == 3


def test_r_forgets_the_last_run_and_drives_it_again(tmp_path: Path, link: RobotLink) -> None:
    journal, script = journal_in(tmp_path / "rec"), Script({"next forward-neutral": ["r"]})
    assert session(link, journal, script).run()
    assert [line for line in script.heard if line.startswith("next")] == [
        "next forward-forward 1 0/2",
        "next forward-neutral 1 1/2",
        "next forward-forward 1 0/2",
        "next forward-neutral 1 1/2",
    ]
    assert kept(journal) == [2, 3]


def test_r_with_nothing_recorded_goes_on(tmp_path: Path, link: RobotLink) -> None:
    journal, script = journal_in(tmp_path / "rec"), Script({"next forward-forward": ["r"]})
    assert session(link, journal, script).run()
    assert "say nothing has been recorded that could be repeated" in script.heard
    assert kept(journal) == [1, 2]


def test_p_pauses_and_q_quits(tmp_path: Path, link: RobotLink) -> None:
    script = Script({"next forward-neutral": ["p"], "say paused": ["q"]})
    journal = journal_in(tmp_path / "rec")
    assert not session(link, journal, script).run()
    assert kept(journal) == [1]


def test_keys_pressed_before_a_drive_do_not_stop_it(tmp_path: Path, link: RobotLink) -> None:
    journal, script = (
        journal_in(tmp_path / "rec"),
        Script({"next forward-forward": ["x", "y", "z"]}),
    )
    assert session(link, journal, script).run()
    assert kept(journal) == [1, 2]


@pytest.mark.parametrize("times", [1, 2, 3])
def test_unattended_a_run_may_be_spoilt_twice(
    tmp_path: Path, robot: FakeRobot, link: RobotLink, times: int
) -> None:
    journal = journal_in(tmp_path / "rec")
    answer, count = robot.replies[COMMAND.name], iter(range(100))
    robot.replies[COMMAND.name] = lambda data: (
        CommandReply(schema_version=1, reason="too hot")
        if 1 <= next(count) <= times
        else answer(data)
    )
    if times < 3:
        assert session(link, journal, Script(), attended=False).run()
        assert kept(journal) == [1, 2 + times]
    else:
        with pytest.raises(SpoiltRunError, match="too hot"):
            session(link, journal, Script(), attended=False).run()
        assert kept(journal) == [1]


def test_a_lost_link_ends_the_session_and_says_what_that_means(
    tmp_path: Path, robot: FakeRobot, link: RobotLink, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(remote_control, "STOP_TIMEOUT_S", 0.1)
    journal, script = journal_in(tmp_path / "rec"), Script()
    answer = robot.replies[COMMAND.name]

    def silent_in_the_second_run(data: bytes):
        if len(journal.runs) == 0:
            return answer(data)
        robot.replies[STOP.name] = lambda _data: None
        return None

    robot.replies[COMMAND.name] = silent_in_the_second_run
    with pytest.raises(UnreachableError, match="STOP was not confirmed"):
        session(link, journal, script, attended=False).run()
    assert kept(journal) == [1]


def test_a_robot_that_restarts_ends_the_session(
    tmp_path: Path, robot: FakeRobot, link: RobotLink, monkeypatch: pytest.MonkeyPatch
) -> None:
    journal, script = journal_in(tmp_path / "rec"), Script()
    truth = robot.now_ns

    def restart(text: str) -> None:
        if text.startswith("next forward-neutral"):
            monkeypatch.setattr(robot, "now_ns", lambda: truth() - 4_000_000_000_000)

    monkeypatch.setattr(script, "hear", restart)
    with pytest.raises(Exception, match="clock started over"):
        session(link, journal, script).run()
    assert kept(journal) == [1]


def test_a_real_terminal_gives_single_keys() -> None:
    master, terminal = pty.openpty()
    try:
        with Keyboard(terminal) as keys:
            assert keys.pressed() is None
            os.write(master, b"Pq\n")
            assert until(lambda: keys.pressed() == "p")
            assert (keys.pressed(), keys.pressed(), keys.pressed()) == ("q", "enter", None)
    finally:
        os.close(master)
        os.close(terminal)


# The command


def environment(robot: FakeRobot) -> dict[str, str]:
    return without_robot() | {"TERM": "xterm", "MBOT_ROBOT": robot.address}


def maneuvers(robot: FakeRobot, *arguments: str) -> subprocess.CompletedProcess[str]:
    return ran(*WORKSTATION, "maneuvers", *arguments, env=environment(robot))


SHORT = ("run", "--yes", "--seconds", "0.3", "--pause", "0", "--repetitions", "2")


@pytest.mark.slow
def test_the_command_records_and_resumes(robot: FakeRobot, tmp_path: Path) -> None:
    folder = tmp_path / "rec"
    only = ("--maneuver", "forward-forward", "--maneuver", "backward-backward")
    run = maneuvers(robot, *SHORT, *only, "--output", str(folder))
    assert run.returncode == 0, run.stderr
    assert "4 of 4: backward-backward, repetition 2, kept as run 4" in run.stdout
    assert sorted(path.name for path in folder.iterdir()) == [
        "commands.csv",
        "recording.toml",
        "telemetry.mcap",
    ]
    again = maneuvers(robot, *SHORT, *only, "--output", str(folder))
    assert (again.returncode, "--resume" in again.stderr) == (2, True)
    more = maneuvers(robot, *SHORT, *only, "--resume", str(folder), "--maneuver", "neutral-forward")
    assert more.returncode == 0, more.stderr
    assert "6 runs are in" in more.stdout
    assert (folder / "telemetry-2.mcap").exists()
    done = maneuvers(robot, *SHORT, *only, "--resume", str(folder))
    assert (done.returncode, "recorded already" in done.stdout) == (0, True)


def test_what_could_not_be_identified_is_not_driven(robot: FakeRobot, tmp_path: Path) -> None:
    run = maneuvers(robot, "run", "--yes", "--repetitions", "1", "--output", str(tmp_path / "rec"))
    assert (run.returncode, "--repetitions is 1, expected 2 or more" in run.stderr) == (2, True)
    assert robot.received == []
    assert not (tmp_path / "rec").exists()


def test_nothing_moves_unless_somebody_agrees(robot: FakeRobot, tmp_path: Path) -> None:
    run = maneuvers(robot, "run", "--output", str(tmp_path / "rec"))
    assert (run.returncode, "--yes" in run.stderr) == (2, True)
    assert robot.received == []
    assert not (tmp_path / "rec").exists()


def test_ctrl_c_stops_the_robot_and_keeps_what_was_recorded(
    robot: FakeRobot, tmp_path: Path
) -> None:
    folder = tmp_path / "rec"
    command = [*WORKSTATION, "maneuvers", *SHORT, "--output", str(folder)]
    pipe = subprocess.PIPE
    with subprocess.Popen(
        command,
        env=environment(robot),
        stdin=subprocess.DEVNULL,
        stdout=pipe,
        stderr=pipe,
        text=True,
    ) as process:
        assert until(lambda: robot.names().count(STOP.name) >= 2)
        stops = robot.names().count(STOP.name)
        count = len(drives(robot))
        assert until(lambda: len(drives(robot)) > count)
        process.send_signal(signal.SIGINT)
        out, errors = process.communicate(timeout=LIMIT_S)
    assert process.returncode == 130, errors
    assert "Traceback" not in errors
    assert f"go on by --resume {folder}" in out
    assert robot.names()[-1] == STOP.name
    assert robot.names().count(STOP.name) > stops
    assert len(read_commands(folder / "commands.csv")) >= 2


@contextmanager
def in_a_terminal(robot: FakeRobot, *arguments: str) -> Iterator[tuple[int, Callable[[], str]]]:
    """The command with a terminal around it: where to type, and what it has shown."""
    master, terminal = pty.openpty()
    command = [*WORKSTATION, "maneuvers", *arguments]
    process = subprocess.Popen(
        command,
        env=environment(robot),
        stdin=terminal,
        stdout=terminal,
        stderr=terminal,
        start_new_session=True,
    )
    os.close(terminal)
    os.set_blocking(master, False)
    shown = bytearray()

    def read() -> str:
        try:
            while data := os.read(master, 4096):
                shown.extend(data)
        except OSError:
            pass  # nothing new, or it has ended
        return shown.decode(errors="replace")

    try:
        yield master, read
        assert until(lambda: read() is not None and process.poll() is not None)
    finally:
        process.kill()
        process.wait()
        os.close(master)
    assert process.returncode == 0, shown.decode(errors="replace")


def test_in_a_terminal_it_asks_and_obeys_keys(robot: FakeRobot, tmp_path: Path) -> None:
    arguments = ("run", "--seconds", "0.3", "--pause", "0.3", "--repetitions", "2")
    with in_a_terminal(robot, *arguments, "--output", str(tmp_path / "rec")) as (keyboard, shown):
        assert until(lambda: "may the robot drive?" in shown())
        assert drives(robot) == []
        os.write(keyboard, b"y\n")
        assert until(lambda: "run 1: forward-forward" in shown())
        os.write(keyboard, b"p")
        assert until(lambda: "Enter goes on" in shown())
        os.write(keyboard, b"q")
        assert until(lambda: "go on by --resume" in shown())
    assert len(read_commands(tmp_path / "rec" / "commands.csv")) >= 1
    assert robot.names()[-1] != COMMAND.name


def test_no_is_an_answer(robot: FakeRobot, tmp_path: Path) -> None:
    with in_a_terminal(robot, "run", "--output", str(tmp_path / "rec")) as (keyboard, shown):
        assert until(lambda: "may the robot drive?" in shown())
        os.write(keyboard, b"n\n")
    assert drives(robot) == []


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--maneuver", "sideways"), "no maneuver 'sideways'"),
        (("--output", "a", "--resume", "b"), "exclude each other"),
        (("--resume", "nowhere"), "is not a recording"),
        (("--calibration", "nowhere"), "no calibration folder"),
        (("--seconds", "0"), "--seconds"),
    ],
)
def test_nonsense_is_refused(robot: FakeRobot, arguments: tuple[str, ...], words: str) -> None:
    result = CliRunner().invoke(app, ["run", "--yes", "--robot", robot.address, *arguments])
    assert words in f"{result.exception} {result.output}"
    assert drives(robot) == []


def test_the_list_is_readable_by_people_and_machines(robot: FakeRobot) -> None:
    assert "backward-neutral" in maneuvers(robot, "list").stdout
    rows = json.loads(maneuvers(robot, "list", "--json", "--seconds", "5").stdout)
    assert len(rows) == 9
    assert rows[0] == {"name": "forward-forward", "left": 1.0, "right": 1.0} | {
        "length_m": rows[0]["length_m"],
        "width_m": rows[0]["width_m"],
    }
    assert 2 < rows[0]["length_m"] < 3


def test_a_plan_says_how_much_floor_it_needs_to_which_side() -> None:
    straight = reach([maneuver_named("forward-forward")], 5.0)
    assert straight.ahead_m == pytest.approx(2.6, abs=0.1)
    assert straight.behind_m == pytest.approx(0.3)
    assert reach([maneuver_named("backward-backward")], 5.0).behind_m == straight.ahead_m
    to_the_left = reach([maneuver_named("neutral-forward")], 5.0)
    to_the_right = reach([maneuver_named("forward-neutral")], 5.0)
    assert to_the_left.left_m == to_the_right.right_m > to_the_left.right_m
    everything = reach(MANEUVERS, 5.0)
    assert everything.ahead_m == everything.behind_m == straight.ahead_m
