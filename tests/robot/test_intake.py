"""Pushes in pieces: in order, one at a time, no longer than they may take, whole or forgotten."""

import time

import pytest

from mbot_agent.intake import EXPIRES_S, Intake, replied
from mbot_protocol.errors import RefusedError
from mbot_protocol.v1.messages_pb2 import PushChunk, PushReply


def add(intake: Intake[str], push_id: str, offset: int, data: bytes) -> PushReply:
    payload = PushChunk(schema_version=1, push_id=push_id, offset_bytes=offset, data=data)
    reply = PushReply()
    intake.add(payload.SerializeToString(), reply)
    return reply


def test_pieces_come_in_order_and_no_more_than_announced() -> None:
    kept, dropped = bytearray(), list[str]()
    intake = Intake[str](60.0, dropped.append)
    push = intake.begin("this", 5, kept.extend)
    assert add(intake, push, 0, b"ab").received_bytes == 2
    for offset, data in ((0, b"x"), (3, b"x"), (2, b""), (2, b"abcd")):
        with pytest.raises(RefusedError):
            add(intake, push, offset, data)
    with pytest.raises(RefusedError, match="not under way"):
        add(intake, "another", 2, b"cde")
    add(intake, push, 2, b"cde")
    reply = PushReply()
    assert intake.take(push, reply) == "this"
    assert (kept, reply.push_id, reply.received_bytes) == (b"abcde", push, 5)
    with pytest.raises(RefusedError, match="not under way"):
        intake.take(push, reply)
    assert dropped == []


def test_half_of_it_is_not_the_whole() -> None:
    dropped: list[str] = []
    intake = Intake[str](60.0, dropped.append)
    push = intake.begin("this", 2, len)
    add(intake, push, 0, b"a")
    with pytest.raises(RefusedError, match="1 of 2"):
        intake.take(push, PushReply())
    intake.give_up()
    assert dropped == ["this"]
    intake.begin("that", 2, len)


def test_there_is_one_at_a_time_unless_it_takes_the_others_place() -> None:
    dropped: list[str] = []
    intake = Intake[str](60.0, dropped.append)
    first = intake.begin("this", 2, len)
    for wanted in (intake.check_free, lambda: intake.begin("that", 2, len)):
        with pytest.raises(RefusedError, match="another push is under way"):
            wanted()
    add(intake, first, 0, b"a")
    again = intake.begin("this", 2, len, replaces=lambda other: other == "this")
    assert dropped == ["this"]
    with pytest.raises(RefusedError, match="not under way"):
        add(intake, first, 1, b"b")
    add(intake, again, 0, b"a")


def test_a_piece_that_comes_too_late_finds_its_push_forgotten(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    dropped: list[str] = []
    intake = Intake[str](60.0, dropped.append)
    push = intake.begin("this", 2, len)
    later_s = time.monotonic() + EXPIRES_S + 1
    monkeypatch.setattr(time, "monotonic", lambda: later_s)
    with pytest.raises(RefusedError, match="not under way"):
        add(intake, push, 0, b"a")
    assert dropped == ["this"]


@pytest.mark.parametrize(("every_s", "lasts_s"), [(EXPIRES_S + 1, EXPIRES_S), (5.0, 60.0)])
def test_a_sender_who_is_silent_or_slow_is_forgotten(
    every_s: float, lasts_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    dropped: list[str] = []
    now_s = time.monotonic()
    monkeypatch.setattr(time, "monotonic", lambda: now_s)
    intake = Intake[str](60.0, dropped.append)
    push, began_s, sent = intake.begin("this", 100, len), now_s, 0
    while not dropped:
        now_s += every_s
        intake.expire()
        if not dropped:
            add(intake, push, sent, b"x")
            sent += 1
    assert lasts_s < now_s - began_s <= lasts_s + every_s
    with pytest.raises(RefusedError, match="not under way"):
        add(intake, push, sent, b"x")
    assert dropped == ["this"]


def test_a_reply_says_why_not() -> None:
    def refuse(_: PushReply) -> None:
        raise RefusedError("no")

    assert PushReply.FromString(replied("push", lambda _: None)).accepted
    refused = PushReply.FromString(replied("push", refuse))
    assert (refused.accepted, refused.reason) == (False, "no")
