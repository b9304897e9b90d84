"""Decisions in recordings of strangers: small messages that speak of much."""

from math import inf, nan

import pytest
from google.protobuf.message import DecodeError

from mbot_protocol.beat.beat import MOST_BYTES, MOST_TOLD, Beat, read_decision
from mbot_protocol.drive.actions import AS_BUILT
from mbot_protocol.drive.actions import Steps as MotorSteps
from mbot_protocol.v1.messages_pb2 import Decision, Fault, State, Steps, Wheels


def test_what_a_robot_says_is_read() -> None:
    told = Decision(sequence=7, faults=[Fault(kind="camera-lost", detail="no frame")] * MOST_TOLD)
    assert read_decision(told.SerializeToString()) == told


@pytest.mark.parametrize(
    "data",
    [
        b"\x32\x00" * (MOST_TOLD + 1),
        Decision(steps=Steps(left=-251)).SerializeToString(),
        b"\xca\x01\x00" * (MOST_TOLD + 1),
        b"\x12\x80\x80\x04" + b"a" * MOST_BYTES,
        b"\xff",
        Decision(board_m1=256).SerializeToString(),
        Decision(duty=Wheels(left=1.5)).SerializeToString(),
        Decision(duty=Wheels(right=nan)).SerializeToString(),
        Decision(would_have_done=Wheels(left=inf)).SerializeToString(),
    ],
    ids=[
        "empty faults",
        "a step too far",
        "empty notices",
        "a long name",
        "damaged",
        "a motor too far",
        "a duty too far",
        "a duty that is none",
        "an answer that is none",
    ],
)
def test_what_no_robot_says_is_left_out(data: bytes) -> None:
    with pytest.raises(DecodeError):
        read_decision(data)


def test_what_the_wheels_were_told_is_known_whoever_told_them() -> None:
    manual = State.STATE_MANUAL
    hand = AS_BUILT.duties(MotorSteps(100, -50))
    duty, none = Wheels(left=hand.left, right=hand.right), Wheels()
    m1, m2 = AS_BUILT.levels(hand)
    steps = Steps(left=100, right=-50)
    told = 0.4, -0.2
    for decision in (
        Decision(state=manual, duty=duty),
        Decision(state=manual, board_m1=m1, board_m2=m2),  # by a release of before
        Decision(steps=steps, duty=duty),
        Decision(steps=steps),
    ):
        assert Beat(decision).at_wheels(AS_BUILT) == told
    # A stop came between the decision and the board.
    assert Beat(Decision(steps=steps, duty=none)).at_wheels(AS_BUILT) == (0, 0)
    assert Beat(Decision(steps=steps, duty=duty)).at_wheels() == told
    raw = Beat(Decision(state=manual, duty=duty)).at_wheels()
    assert raw == pytest.approx((hand.left, hand.right)), "as nobody says what became of it"
