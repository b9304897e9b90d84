"""The daemon's link, and somebody at its other end, both in this process."""

import threading
import time
from collections.abc import Iterator

import pytest
import zenoh

from mbot_agent.configuration import Configuration, Network
from mbot_agent.network.requests import Request
from mbot_agent.network.zenoh_link import Link
from mbot_protocol.keys import DECISION, OBSERVATION, RECORDINGS, STATUS
from mbot_workstation.link.address import parse_address
from mbot_workstation.link.robot_session import open_session

from ..free_port import free_port
from ..until import until


@pytest.fixture
def ends() -> Iterator[tuple[Link, zenoh.Session]]:
    port = free_port()
    configuration = Configuration(
        robot_id="mbot-1", network=Network(listen=(f"tcp/127.0.0.1:{port}",))
    )
    with (
        Link(configuration) as link,
        open_session(parse_address(f"127.0.0.1:{port}"), None) as session,
    ):
        yield link, session


def answers(session: zenoh.Session, key: str, timeout_s: float = 2.0) -> list[bytes]:
    replies = session.get(key, payload=b"x", timeout=timeout_s)
    return [reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None]


def test_a_topic_is_watched_while_somebody_subscribes(ends: tuple[Link, zenoh.Session]) -> None:
    """Else pictures would be made for nobody."""
    link, session = ends
    assert not link.is_watched(OBSERVATION)
    with session.declare_subscriber(OBSERVATION.key("mbot-1"), zenoh.handlers.RingChannel(1)):
        assert until(lambda: link.is_watched(OBSERVATION), 5)
        assert not link.is_watched(DECISION)
    assert until(lambda: not link.is_watched(OBSERVATION), 5)


def test_whoever_asks_by_a_wildcard_asks_nobody(ends: tuple[Link, zenoh.Session]) -> None:
    link, session = ends
    link.serve({STATUS.name: lambda _: b"status"})
    assert answers(session, STATUS.key("mbot-1")) == [b"status"]
    assert answers(session, STATUS.key("*"), 0.5) == []


def test_answers_of_one_kind_take_turns(ends: tuple[Link, zenoh.Session]) -> None:
    link, session = ends
    at_once, most = [0], [0]

    def slow(_: bytes) -> bytes:
        at_once[0] += 1
        most[0] = max(most[0], at_once[0])
        time.sleep(0.05)
        at_once[0] -= 1
        return b"done"

    link.serve({STATUS.name: slow, RECORDINGS.name: slow})
    keys = [STATUS.key("mbot-1"), RECORDINGS.key("mbot-1")] * 4
    asking = [threading.Thread(target=answers, args=(session, key)) for key in keys]
    for one in asking:
        one.start()
    for one in asking:
        one.join()
    assert most == [1]
    assert link.queries == len(keys)


def test_a_service_that_stumbles_serves_the_next(ends: tuple[Link, zenoh.Session]) -> None:
    link, session = ends

    def stumble(payload: bytes) -> bytes:
        raise ValueError(payload)

    [listener] = link.serve({STATUS.name: stumble})
    assert answers(session, STATUS.key("mbot-1")) == []
    assert answers(session, STATUS.key("mbot-1")) == []
    assert listener.taken == 2


def test_progress_is_of_the_question_at_hand(ends: tuple[Link, zenoh.Session]) -> None:
    link, session = ends
    go_on = threading.Event()

    def hang(request: Request) -> None:
        go_on.wait(5)
        request.answer(b"at last")

    listener = link.listen(STATUS.name, hang)
    assert time.monotonic_ns() - listener.progress_ns < 10**8
    began_ns = time.monotonic_ns()
    asking = threading.Thread(target=answers, args=(session, STATUS.key("mbot-1")))
    asking.start()
    assert until(lambda: time.monotonic_ns() - listener.progress_ns > 3 * 10**8, 5)
    assert listener.progress_ns >= began_ns
    go_on.set()
    asking.join()
    assert until(lambda: time.monotonic_ns() - listener.progress_ns < 10**8, 5)
