"""Replies go out from threads of their own; here to peers that do not read."""

import threading
from typing import Self, cast

import pytest
import zenoh

from mbot_agent.network import requests
from mbot_agent.network.requests import Replies

from ..until import until


class Query:
    """A query of somebody who reads when the test says so.

    Attributes:
        replies: what he was sent.
        ended: how: "replied to", or "dropped" without a thread's help.

    """

    key_expr = "mbot/mbot-1/status"

    def __init__(self, reads: threading.Event) -> None:
        self.replies: list[bytes] = []
        self.ended = ""
        self.begun = False
        self._reads = reads

    def __enter__(self) -> Self:
        self.begun = True
        return self

    def __exit__(self, *_: object) -> None:
        self.ended = "replied to"

    def reply(self, _key: object, reply: bytes, *, encoding: object) -> None:
        assert self._reads.wait(20)
        self.replies.append(reply)
        if reply == b"gone":
            raise OSError("the peer has gone")

    def drop(self) -> None:
        self.ended = "dropped"


def send(replies: Replies, query: Query, reply: bytes | None = b"ok") -> Query:
    replies.send(cast(zenoh.Query, query), reply)
    return query


@pytest.fixture
def reads() -> threading.Event:
    event = threading.Event()
    event.set()
    return event


def test_there_is_room_again_for_each_that_went_out_or_failed(
    monkeypatch: pytest.MonkeyPatch, reads: threading.Event
) -> None:
    monkeypatch.setattr(requests, "MOST_UNSENT", 2)
    replies = Replies("status", 1)
    for reply in (b"ok", b"gone") * 5:
        query = send(replies, Query(reads), reply)
        assert until(lambda query=query: query.ended)
        assert (query.replies, query.ended) == ([reply], "replied to")
    replies.close()


def test_a_query_may_be_ended_without_a_reply(reads: threading.Event) -> None:
    replies = Replies("status", 1)
    query = send(replies, Query(reads), None)
    assert until(lambda: query.ended)
    assert (query.replies, query.ended) == ([], "replied to")
    replies.close()


def test_who_asks_more_than_is_kept_is_not_waited_for(
    monkeypatch: pytest.MonkeyPatch, reads: threading.Event
) -> None:
    monkeypatch.setattr(requests, "MOST_UNSENT", 2)
    replies = Replies("status", 1)
    reads.clear()
    kept = [send(replies, Query(reads)) for _ in range(2)]
    more = send(replies, Query(reads))
    assert (more.ended, [query.ended for query in kept]) == ("dropped", ["", ""])
    reads.set()
    assert until(lambda: all(query.ended for query in kept))
    assert [query.replies for query in kept] == [[b"ok"], [b"ok"]]
    replies.close()


def test_closing_waits_for_nobody_and_sends_nothing_more(reads: threading.Event) -> None:
    replies = Replies("status", 1)
    reads.clear()
    first, second = send(replies, Query(reads)), send(replies, Query(reads))
    assert until(lambda: first.begun)
    replies.close()
    assert first.ended == ""
    reads.set()
    assert until(lambda: first.ended)
    assert not until(lambda: second.begun, 0.2)
