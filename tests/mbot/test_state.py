"""What a robot says of itself, in a program's words."""

import dataclasses

import pytest

from mbot import RobotState
from mbot.state import look_again
from mbot_protocol.errors import RefusedError
from mbot_protocol.v1.messages_pb2 import Fault, LastStop, Model, Notice, Senses, State, Status
from mbot_workstation.fleet.link.remote_control import RemoteControl
from mbot_workstation.fleet.link.robot_link import RobotLink

from ..workstation.fake_robot import FakeRobot


def test_it_is_what_the_status_has_and_safe_to_print() -> None:
    status = Status(
        robot_id="mbot-1",
        state=State.STATE_STOPPED,
        now_monotonic_ns=5_000_000_000,
        faults=[Fault(kind="no-model", detail="no model yet;\x1b[2J push one")],
        notices=[Notice(kind="old", detail="upgrade")],
        last_stop=LastStop(count=2, by="max", monotonic_ns=1_000_000_000),
        active_model=Model(name="a\nb", sha256="ab" * 32),
        decision_rate_hz=2.5,
        release="1.0",
    )
    state = RobotState.of(status)
    assert state.faults == ("no-model: no model yet; [2J push one",)
    assert (state.robot, state.state, state.may_run) == ("mbot-1", "stopped", False)
    assert (state.notices, state.last_stop) == (("old: upgrade",), "stopped by max 4.0 s ago")
    assert (state.model, state.decisions_per_s, state.release) == ("a b", 2.5, "1.0")
    with pytest.raises(dataclasses.FrozenInstanceError):
        state.state = "running"  # pyright: ignore[reportAttributeAccessIssue]


def test_a_hand_that_let_go_is_told_apart_from_a_stop() -> None:
    status = Status(now_monotonic_ns=3_000_000_000, let_go_monotonic_ns=2_000_000_000)
    assert RobotState.of(status).last_stop == "the hand let go 1.0 s ago"
    assert RobotState.of(Status()).may_run


def test_what_a_board_feels_is_told_and_what_it_does_not_feel_is_not() -> None:
    felt = RobotState.of(Status(senses=Senses(distance_m=0.25, floor_1=True)))
    assert (felt.distance_m, felt.floor) == (0.25, (True, False))
    unfelt = RobotState.of(Status())
    assert (unfelt.distance_m, unfelt.floor) == (None, None)


def test_a_look_is_good_until_the_next_stop(fake: FakeRobot) -> None:
    with RobotLink(fake.address) as link:
        seen = link.status()
        look_again(RemoteControl(link), seen)
        fake.stops += 1
        with pytest.raises(RefusedError) as refused:
            look_again(RemoteControl(link), seen)
    assert refused.value.remedy == "look with robot.state(), then do it again"
