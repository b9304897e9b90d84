import time
from collections.abc import Iterator
from typing import Any

import pytest
from typer.testing import CliRunner

from mbot_protocol.errors import ConfigurationError, RefusedError, UnreachableError
from mbot_protocol.v1.messages_pb2 import CommandReply, State
from mbot_protocol.wire.keys import COMMAND, STATUS, STOP
from mbot_protocol.wire.schema import SCHEMA_VERSION
from mbot_workstation.cli.subcommands import app
from mbot_workstation.fleet.by_hand.timed_drive import HOLD_MS, drive_for
from mbot_workstation.fleet.link import remote_control
from mbot_workstation.fleet.link.remote_control import (
    BEGIN_WAIT_S,
    CONFIRM_PAUSE_S,
    LOOK_PAUSE_S,
    STOP_PAUSE_S,
    TIME_TO_LIVE_S,
    NotStandingError,
    RemoteControl,
    RobotClock,
)
from mbot_workstation.fleet.link.robot_link import RobotLink

from .fake_robot import SESSION_ID, FakeRobot


@pytest.fixture
def control(robot: FakeRobot) -> Iterator[RemoteControl]:
    with RobotLink(robot.address) as link:
        yield RemoteControl(link)


def test_the_estimate_of_the_robots_clock_is_never_ahead() -> None:
    # The reply left the robot at its 1000 and took until our 50; now it is 80 here.
    clock = RobotClock(robot_ns=1000, arrived_ns=50)
    assert clock.expiry_ns(now_ns=80, time_to_live_s=2e-9) == 1000 + 30 + 2


def test_run_and_drive_carry_session_and_expiry(robot: FakeRobot, control: RemoteControl) -> None:
    assert control.run() == "running"
    assert control.drive(0.5, -0.25, 300) == "manual"
    run, drive = robot.commands()
    for command in (run, drive):
        assert command.schema_version == SCHEMA_VERSION
        assert command.robot_id == "mbot-1"
        assert command.session_id == SESSION_ID
        left_ns = command.expires_monotonic_ns - robot.now_ns()
        assert left_ns <= TIME_TO_LIVE_S * 1e9
        assert left_ns > -10e9  # on the robot's clock, which is hours ahead of ours
        assert command.stop_count == robot.stops
        assert command.sender
    assert (run.number, drive.number) == (1, 2)
    assert run.sender_id == drive.sender_id != 0
    assert (drive.drive.wheels.left, drive.drive.wheels.right) == (0.5, -0.25)
    assert drive.drive.hold_ms == 300
    assert robot.names() == ["status", "command", "command"]


def test_a_mark_is_sent_by_command(robot: FakeRobot) -> None:
    result = CliRunner().invoke(app, ["mark", "--back", "2", "--robot", robot.address])
    assert result.output == "mbot-1: marked: the 2 s until now were wrong\n", result.exception
    (command,) = robot.commands()
    assert command.mark.back_ms == 2000
    assert command.expires_monotonic_ns, "late it would mark other seconds"


def test_no_two_senders_are_taken_for_one(robot: FakeRobot) -> None:
    """Else the one's command would make the other's an old one."""
    with RobotLink(robot.address) as link:
        for _ in range(8):
            RemoteControl(link).run()
    senders = {command.sender_id for command in robot.commands()}
    assert len(senders) == 8
    assert 0 not in senders


def test_nothing_is_set_in_motion_that_a_stop_would_not_reach(
    robot: FakeRobot, control: RemoteControl, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(RobotLink, "reaches", lambda _self, topic: topic is not STOP)
    for command in (control.run, lambda: control.drive(0.5, 0.5, 300)):
        with pytest.raises(UnreachableError, match="a STOP does not get through to robot mbot-1"):
            command()
    assert robot.commands() == []
    assert control.stop() == "stopped"  # it is tried all the same


def test_a_command_that_was_held_up_is_refused(robot: FakeRobot, control: RemoteControl) -> None:
    answer = robot.replies[COMMAND.name]

    def late(data: bytes):
        time.sleep(TIME_TO_LIVE_S + 0.1)
        return answer(data)

    robot.replies[COMMAND.name] = late
    with pytest.raises(RefusedError, match="mbot-1 refused: it came too late"):
        control.run()


def test_a_hands_command_is_good_for_no_longer_than_it_holds(
    robot: FakeRobot, control: RemoteControl
) -> None:
    control.drive(0.5, 0.5, 300, press=4)
    control.let_go(4)
    drive, over = robot.commands()
    assert drive.expires_monotonic_ns <= robot.now_ns() + 300_000_000
    assert (drive.drive.press, drive.drive.let_go) == (4, False)
    assert (over.drive.press, over.drive.let_go, over.drive.hold_ms) == (4, True, 1)


def test_after_a_stop_of_ones_own_one_takes_hold_again(
    robot: FakeRobot, control: RemoteControl
) -> None:
    """As each of the maneuvers does: of a press that is over a robot takes no more."""
    for _ in range(2):
        control.drive(0.5, 0.5, 300)
        control.drive(0.5, 0.5, 300)
        control.stop()
    presses = [one.drive.press for one in robot.commands() if one.WhichOneof("action") == "drive"]
    assert presses == [1, 1, 2, 2]


def test_nobody_drives_on_through_somebodys_stop(robot: FakeRobot, control: RemoteControl) -> None:
    control.drive(0.5, 0.5, 300)
    robot.stops += 1
    for _ in range(2):  # and not on the second try either
        with pytest.raises(RefusedError, match="stopped by max"):
            control.drive(0.5, 0.5, 300)
    control.synchronise()
    assert control.drive(0.5, 0.5, 300) == "manual"


def test_on_behalf_of_a_display_only_the_stop_that_it_showed_counts(
    robot: FakeRobot, control: RemoteControl
) -> None:
    control.catch_up(robot.stops)
    assert control.drive(0.5, 0.5, 300) == "manual"
    seen = robot.stops
    robot.stops += 1
    with pytest.raises(RefusedError, match="look, then do it again"):
        control.catch_up(seen)
    assert robot.names().count("command") == 1
    control.catch_up(robot.stops)
    assert control.drive(0.5, 0.5, 300) == "manual"


def test_after_a_stop_of_ones_own_one_looks_again(robot: FakeRobot, control: RemoteControl) -> None:
    control.run()
    control.stop()
    assert control.run() == "running"
    assert robot.names() == ["status", "command", "stop", "status", "command"]


def test_a_robot_that_does_not_confirm_that_it_stands(
    robot: FakeRobot, control: RemoteControl
) -> None:
    began_s = time.monotonic()
    robot.replies[STOP.name] = lambda _data: CommandReply(
        schema_version=1, accepted=True, state=State.STATE_STOPPED, reason="the board is lost"
    )
    with pytest.raises(
        NotStandingError, match="not confirmed that it has stopped: the board is"
    ) as raised:
        control.stop()
    assert raised.value.exit_code == 1
    assert len(robot.commands()) == 8
    assert time.monotonic() - began_s > 7 * CONFIRM_PAUSE_S, "a board has its time to answer"


def test_a_board_that_confirms_late_is_asked_again_soon(
    robot: FakeRobot, control: RemoteControl, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not after the pause that a link which is down gets."""
    monkeypatch.setattr(remote_control, "STOP_PAUSE_S", 2.0)
    answer = robot.replies[STOP.name]
    late = iter([True, True, False])
    not_yet = CommandReply(schema_version=1, accepted=True, state=State.STATE_STOPPED)
    robot.replies[STOP.name] = lambda data: not_yet if next(late) else answer(data)
    began_s = time.monotonic()
    assert control.stop() == "stopped"
    assert time.monotonic() - began_s < 2.0
    assert len(robot.commands()) == 3


def test_stop_needs_no_status_and_never_expires(robot: FakeRobot, control: RemoteControl) -> None:
    assert control.stop() == "stopped"
    assert robot.names() == ["stop"]
    assert robot.commands()[0].WhichOneof("action") == "stop"


def test_stop_is_tried_again(
    robot: FakeRobot, control: RemoteControl, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(remote_control, "STOP_TIMEOUT_S", 0.2)
    answer = robot.replies[STOP.name]
    deaf = iter([True, True, False])
    robot.replies[STOP.name] = lambda data: None if next(deaf) else answer(data)
    assert control.stop() == "stopped"


def test_a_stop_without_confirmation_says_what_that_means(
    robot: FakeRobot, control: RemoteControl, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(remote_control, "STOP_TIMEOUT_S", 0.1)
    robot.replies[STOP.name] = lambda _data: None
    with pytest.raises(UnreachableError, match="STOP was not confirmed, the robot may be driving"):
        control.stop()
    assert len(robot.commands()) == 3


def test_a_link_that_is_down_gets_the_time_to_come_back(
    robot: FakeRobot, control: RemoteControl, monkeypatch: pytest.MonkeyPatch
) -> None:
    down_until_s = time.monotonic() + 1.5 * STOP_PAUSE_S
    whole = RobotLink.query

    def query(link: RobotLink, *asked: Any) -> Any:
        if time.monotonic() < down_until_s:
            raise UnreachableError("no link")
        return whole(link, *asked)

    monkeypatch.setattr(RobotLink, "query", query)
    assert control.stop() == "stopped"


def test_after_a_run_that_runs_nothing_is_waited_for(
    robot: FakeRobot, control: RemoteControl
) -> None:
    running = robot.status()
    running.state = State.STATE_RUNNING
    robot.replies[STATUS.name] = lambda _data: running
    assert control.after_run().state == State.STATE_RUNNING
    assert robot.names() == ["status"]


def test_after_a_run_one_beat_and_a_bit_is_waited_for(
    robot: FakeRobot, control: RemoteControl
) -> None:
    standing = robot.status()
    standing.state = State.STATE_FAULT
    robot.replies[STATUS.name] = lambda _data: standing
    for rate_hz, beat_s in ((10.0, 0.1), (1e-30, 2.0), (float("nan"), 2.0)):
        standing.decision_rate_hz = rate_hz
        began_s = time.monotonic()
        assert control.after_run().state == State.STATE_FAULT
        waited_s = time.monotonic() - began_s
        assert beat_s + BEGIN_WAIT_S <= waited_s < beat_s + BEGIN_WAIT_S + 1.0
        assert robot.names().count("status") < 3 + waited_s / LOOK_PAUSE_S
        robot.received.clear()


def test_a_refusal_gives_the_robots_reason(robot: FakeRobot, control: RemoteControl) -> None:
    robot.replies[COMMAND.name] = lambda _data: CommandReply(
        schema_version=1, accepted=False, reason="no model:\npush one"
    )
    with pytest.raises(RefusedError, match="mbot-1 refused: no model: push one"):
        control.run()


def test_a_drive_for_some_time_is_held_by_repeats_and_ends_in_a_stop(
    robot: FakeRobot, control: RemoteControl
) -> None:
    drive_for(control, 0.4, -0.4, 0.6)
    drives = [command.drive for command in robot.commands() if command.HasField("drive")]
    assert len(drives) >= 2
    assert all(0 < drive.hold_ms <= HOLD_MS for drive in drives)
    assert "stop" in robot.names()
    with pytest.raises(ConfigurationError):
        drive_for(control, float("nan"), 0.0, 1.0)
