"""Decisions in recordings of strangers: small messages that speak of much."""

import pytest
from google.protobuf.message import DecodeError

from mbot_protocol.beat.beat import MOST_BYTES, MOST_TOLD, read_decision
from mbot_protocol.v1.messages_pb2 import Decision, Fault, Steps


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
    ],
    ids=["empty faults", "a step too far", "empty notices", "a long name", "damaged"],
)
def test_what_no_robot_says_is_left_out(data: bytes) -> None:
    with pytest.raises(DecodeError):
        read_decision(data)
