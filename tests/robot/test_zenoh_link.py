"""The daemon's link, and somebody at its other end, both in this process."""

import threading
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
import zenoh

from mbot_agent.configuration import Access, Configuration, Network
from mbot_agent.network.doorkeeper import Visitor
from mbot_agent.network.requests import Request
from mbot_agent.network.zenoh_link import (
    Link,
    Listener,
    _reason,  # pyright: ignore[reportPrivateUsage]
)
from mbot_protocol.errors import UnreachableError
from mbot_protocol.wire.keys import (
    ALIVE,
    DECISION,
    DOORS,
    OBSERVATION,
    PRESENCE,
    RECORDINGS,
    STATUS,
    Right,
)
from mbot_workstation.fleet.link.address import parse_address
from mbot_workstation.fleet.link.robot_session import open_session

from ..free_port import free_port
from ..until import until
from .test_certificates import files, robot


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
    asked: list[bytes] = []

    def status(payload: bytes) -> bytes:
        asked.append(payload)
        return b"status"

    link.serve({STATUS.name: status})
    assert answers(session, STATUS.key("mbot-1")) == [b"status"]
    began_s = time.monotonic()
    assert answers(session, STATUS.key("*"), 20.0) == []
    assert time.monotonic() - began_s < 10.0, "and is told so at once"
    assert len(asked) == 1


def test_a_wildcard_is_not_taken_even_if_the_rules_let_it_through() -> None:
    key = STATUS.key("mbot-1")
    asked = [SimpleNamespace(key_expr=one, payload=None) for one in (STATUS.key("*"), key)]
    taken: list[Request] = []
    ended: list[tuple[object, bytes | None]] = []
    replies = SimpleNamespace(send=lambda query, reply: ended.append((query, reply)))
    listener = Listener(cast(Any, asked), key, taken.append, cast(Any, replies))
    assert until(lambda: len(taken) == 1, 5)
    assert ended == [(asked[0], None)]
    assert listener.taken == 2


def test_a_question_without_a_word_is_one(ends: tuple[Link, zenoh.Session]) -> None:
    link, session = ends
    link.serve({STATUS.name: lambda payload: b"nothing" if payload == b"" else payload})
    [reply] = list(session.get(STATUS.key("mbot-1"), timeout=5.0))
    assert reply.ok is not None
    assert reply.ok.payload.to_bytes() == b"nothing"


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
    began_s = time.monotonic()
    for _ in range(2):
        assert answers(session, STATUS.key("mbot-1"), 20.0) == []
    assert time.monotonic() - began_s < 10.0, "nobody waits for what does not come"
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


def test_a_robot_shows_itself_and_its_doors_while_it_is_there(
    ends: tuple[Link, zenoh.Session],
) -> None:
    link, session = ends

    def is_shown(key: str) -> bool:
        return any([reply.ok is not None for reply in session.liveliness().get(key, timeout=5.0)])

    link.announce()
    for topic in (ALIVE, *DOORS.values()):
        assert until(lambda topic=topic: is_shown(topic.key("mbot-1")), 10)
    link.__exit__(None, None, None)
    assert until(lambda: not is_shown(ALIVE.key("mbot-1")), 10)


def test_workstations_are_seen_and_services_answer(ends: tuple[Link, zenoh.Session]) -> None:
    link, session = ends
    assert not link.sees_workstations(1.0)
    token = session.liveliness().declare_token(PRESENCE.key("mbot-1").replace("*", "anna"))
    assert until(lambda: link.sees_workstations(1.0))
    token.undeclare()
    assert until(lambda: not link.sees_workstations(1.0))
    assert not link.answers("status", 1.0)


def test_who_is_connected_is_known_by_address_and_session() -> None:
    came = threading.Event()
    port = free_port()
    configuration = Configuration(
        robot_id="mbot-1", network=Network(listen=(f"tcp/127.0.0.1:{port}",))
    )
    with Link(configuration) as link:
        link.watch_visitors(came.set)
        assert link.visitors() == []
        with open_session(parse_address(f"127.0.0.1:{port}"), None) as session:
            assert came.wait(10)
            assert until(link.visitors)
            [visitor] = link.visitors()
            assert (visitor.name, visitor.session) == (None, str(session.info.zid()))
            host, their_port = visitor.address
            assert host == "127.0.0.1"
            assert their_port != port
            came.clear()
        assert came.wait(10), "gone"
        assert until(lambda: not link.visitors())


def test_a_link_without_a_port_is_nobody_that_could_be_shown_out() -> None:
    link = Link(Configuration(robot_id="mbot-1"))
    there = [
        SimpleNamespace(dst=dst, auth_identifier=None, zid="1")
        for dst in ("unixsock-stream//run/a", "tls/[fe80::1%2]:7447?prio=6-7")
    ]
    info = SimpleNamespace(links=lambda: there)
    link._session = cast(Any, SimpleNamespace(info=info))  # pyright: ignore[reportPrivateUsage]
    assert link.visitors() == [Visitor(None, ("fe80::1", 7447), "1")]


def test_what_a_link_has_begun_ends_with_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """And Zenoh says nothing by itself."""
    levels: list[str] = []
    monkeypatch.setattr(zenoh, "init_log_from_env_or", levels.append)
    port = free_port()
    network = Network(listen=(f"tcp/127.0.0.1:{port}",))
    with Link(Configuration(robot_id="mbot-1", network=network)) as link:
        link.serve({STATUS.name: lambda _: b"status"})
        with open_session(parse_address(f"127.0.0.1:{port}"), None) as session:
            assert answers(session, STATUS.key("mbot-1")) == [b"status"]
        assert replying()
    assert until(lambda: not replying(), 5)
    assert levels == ["off"]


def replying() -> list[str]:
    return [one.name for one in threading.enumerate() if one.name.startswith("reply status")]


def test_a_topic_is_declared_once(ends: tuple[Link, zenoh.Session]) -> None:
    link, _ = ends
    declared = [link._publisher(DECISION) for _ in range(2)]  # pyright: ignore[reportPrivateUsage]
    assert declared[0] is declared[1]


def test_what_is_published_arrives_in_order(ends: tuple[Link, zenoh.Session]) -> None:
    link, session = ends
    heard: list[bytes] = []
    with session.declare_subscriber(
        DECISION.key("mbot-1"), lambda sample: heard.append(sample.payload.to_bytes())
    ):
        assert until(lambda: link.is_watched(DECISION), 10)
        for number in range(3):
            link.publish(DECISION, bytes([number]))
        assert until(lambda: len(heard) == 3, 10)
    assert heard == [b"\0", b"\1", b"\2"]


def test_a_link_gives_its_port_back_and_says_who_has_it() -> None:
    port = free_port()
    configuration = Configuration(
        robot_id="mbot-1", network=Network(listen=(f"tcp/127.0.0.1:{port}",))
    )
    link = Link(configuration)
    link.__exit__(None, None, None)  # it was never opened
    with pytest.raises(UnreachableError, match="not open"):
        link.publish(DECISION, b"")
    with link:
        with pytest.raises(UnreachableError, match=f"port {port} is taken by .*network.listen"):
            Link(configuration).__enter__()
        listen = (f"tcp/127.0.0.1:{free_port()}", f"tcp/127.0.0.1:{port}")  # one of them is free
        both = Configuration(robot_id="mbot-1", network=Network(listen=listen))
        with pytest.raises(UnreachableError, match=f"port {port} is taken"):
            Link(both).__enter__()
    assert link.queries == 0
    with Link(configuration):
        pass


def test_where_nothing_is_found_zenohs_own_words_are_told() -> None:
    """Up to where they say at which line of its source."""
    at = "at /root/.cargo/git/checkouts/zenoh/io/zenoh-link-commons/src/tcp.rs:61."
    nested = f"No listener: [192.0.2.1:7447: No such device (os error 19) {at}] {at}"
    for words, told in (
        (nested, "No such device"),
        (f"Unicast not supported for x protocol {at}", "Unicast not supported for x protocol"),
        ("x" * 1000 + "\nand more", "x" * 160),
    ):
        assert _reason(zenoh.ZError(words)) == told


def test_certificates_that_end_soon_are_told_of(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    for days, told in ((365, False), (20, True)):
        caplog.clear()
        configuration = Configuration(
            robot_id="mbot-1",
            network=Network(
                listen=(f"tls/127.0.0.1:{free_port()}",), tls=files(tmp_path, robot(days=days))
            ),
            access=Access(people={"vera": (Right.VIEW,)}),
        )
        with Link(configuration):
            assert ("expires on" in caplog.text) is told
            assert bool(caplog.records) is told
