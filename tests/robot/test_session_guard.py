"""The guard's thread on real sockets: this process holds both ends."""

import socket
import struct
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import pytest

from mbot_agent.configuration import Access
from mbot_agent.network import doorkeeper, session_guard
from mbot_agent.network.doorkeeper import MOST_A_NAME, Visitor
from mbot_agent.network.session_guard import MOST_HELD_BYTES, MOST_QUERIES, SessionGuard
from mbot_protocol.keys import Right

from ..until import until

ACCESS = Access(people={"vera": (Right.VIEW,)})


def linked() -> tuple[socket.socket, socket.socket, Visitor]:
    """The robot's end, vera's end, and what Zenoh says of the link between them."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        hers = socket.create_connection(server.getsockname())
        ours, address = server.accept()
    return ours, hers, Visitor("person:vera", address, "a session")


def is_shut(end: socket.socket) -> bool:
    end.settimeout(0.01)
    try:
        while data := end.recv(1 << 20):
            assert data
        return True
    except TimeoutError:
        return False
    except OSError:
        return True


def test_who_does_not_read_is_shown_out_and_who_reads_is_not() -> None:
    ours, hers, visitor = linked()
    reads, too, reader = linked()
    ours.setblocking(False)
    with SessionGuard(ACCESS, lambda: [visitor, reader]), suppress(BlockingIOError):
        while True:
            ours.send(bytes(1 << 16))
    with SessionGuard(ACCESS, lambda: [visitor, reader]):
        assert until(lambda: is_shut_for_writing(ours), 3)
        for _ in range(10):
            reads.sendall(b"news")
            assert too.recv(4) == b"news"
            time.sleep(0.03)
        assert not is_shut(too)
    for one in (ours, hers, reads, too):
        one.close()


def is_shut_for_writing(end: socket.socket) -> bool:
    try:
        end.send(b"x")
    except BlockingIOError:
        return False
    except OSError:
        return True
    return False


@pytest.mark.parametrize("access", [ACCESS, Access()])
def test_as_soon_as_somebody_has_come_nobody_will_wait_when_they_are_gone(access: Access) -> None:
    ours, hers, visitor = linked()
    ours.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 10))

    def lingers() -> bool:
        return ours.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, 8)[:4] != bytes(4)

    with SessionGuard(access, lambda: [visitor]) as guard:
        assert lingers()
        guard.look_now()
        assert until(lambda: not lingers(), 0.5)
    assert not is_shut(hers)
    ours.close()
    hers.close()


def test_who_floods_is_shown_out() -> None:
    ours, hers, visitor = linked()
    with SessionGuard(ACCESS, lambda: [visitor]):
        time.sleep(0.15)  # it has looked once
        hers.sendall(bytes(100_000))
        assert until(lambda: is_shut(hers), 3)
    ours.close()
    hers.close()


def test_a_flood_is_told_of_while_it_lasts_and_a_page_that_opens_is_not() -> None:
    told: list[float] = []
    asked = 0

    def ask(each_100_ms: int, times: int) -> None:
        nonlocal asked
        for _ in range(times):
            asked += each_100_ms
            time.sleep(0.1)

    with SessionGuard(ACCESS, list, lambda: asked, lambda: told.append(time.monotonic())):
        ask(MOST_QUERIES // 2, 1)
        ask(0, 12)
        assert told == []
        ask(MOST_QUERIES // 3, 13)
        assert told
        ask(0, 12)
        seen = len(told)
        ask(0, 12)
        assert len(told) == seen


def test_who_says_much_at_once_and_seldom_is_no_flood() -> None:
    """Messages are told from bytes."""
    ours, hers, visitor = linked()
    with SessionGuard(ACCESS, lambda: [visitor]):
        for _ in range(5):
            hers.sendall(bytes(2_000))
            time.sleep(0.1)
            assert not is_shut(hers)
    ours.close()
    hers.close()


@pytest.mark.parametrize("access", [ACCESS, Access()])
def test_leaving_ends_its_thread_at_once(access: Access) -> None:
    with SessionGuard(access, list) as guard:
        thread = guard._thread  # pyright: ignore[reportPrivateUsage]
        time.sleep(0.05)
        began_s = time.monotonic()
    assert not thread.is_alive()
    assert time.monotonic() - began_s < 0.8


def test_it_looks_when_somebody_has_come_and_else_now_and_then() -> None:
    looks: list[float] = []

    def links() -> list[Visitor]:
        looks.append(time.monotonic())
        return []

    with SessionGuard(ACCESS, links) as guard:
        time.sleep(0.5)
        assert 2 <= len(looks) <= 6
        for _ in range(10):
            seen = len(looks)
            guard.look_now()
            assert until(lambda seen=seen: len(looks) > seen)
        assert looks[-1] - looks[-11] < 0.9, "at once"
        seen = len(looks)
        time.sleep(0.3)
        assert len(looks) - seen <= 4
    with SessionGuard(Access(), links) as guard:
        seen = len(looks)
        guard.look_now()
        time.sleep(0.1)
    assert len(looks) == seen, "without certificates there is nobody to be shown out"


def test_what_is_no_tcp_link_is_none_of_its_business() -> None:
    """Sockets of the journal's and systemd's kind, pipes and files; and it keeps none of them."""
    ours, hers, visitor = linked()
    stranger = Visitor("person:nick", visitor.address, "a session")
    one, other = socket.socketpair()
    with one, other, ours, hers:
        kept = len(list(Path("/proc/self/fd").iterdir()))
        with SessionGuard(ACCESS, lambda: [Visitor("person:vera", ("10.0.0.7", 1), "gone")]):
            time.sleep(0.35)
        assert len(list(Path("/proc/self/fd").iterdir())) <= kept
        gone = replace(stranger, address=("10.0.0.7", 1))
        with SessionGuard(ACCESS, lambda: [gone, stranger]):
            assert until(lambda: is_shut(hers), 3)
        one.sendall(b"x")
        assert other.recv(1) == b"x"


def test_when_too_much_is_held_they_go_and_may_come_again(monkeypatch: pytest.MonkeyPatch) -> None:
    held = 50 << 20
    monkeypatch.setattr(session_guard, "anonymous_bytes", lambda: held)
    monkeypatch.setattr(session_guard, "HOLDING_PAUSE_S", 0.0)
    ours, hers, visitor = linked()
    people = {"vera": (Right.VIEW,), "dora": (Right.DRIVE,)}
    busy, busy_end, dora = linked()
    visitors = [visitor, replace(dora, name="person:dora")]
    busy_end.sendall(bytes(5000))
    with SessionGuard(Access(people=people), lambda: visitors):
        held += MOST_HELD_BYTES
        time.sleep(0.3)
        assert not is_shut(hers)
        held += 1
        assert until(lambda: is_shut(hers) and is_shut(busy_end), 3)
        again, again_end, vera = linked()
        visitors[:] = [vera]
        time.sleep(0.3)
        assert not is_shut(again_end), "it is held still, and not for her"
        held += MOST_HELD_BYTES // 2
        assert until(lambda: is_shut(again_end), 3)
    for end in (ours, hers, busy, busy_end, again, again_end):
        end.close()


def test_memory_that_came_back_lowers_the_bar_and_one_that_does_not_is_no_lock_out(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    held = 50 << 20
    monkeypatch.setattr(session_guard, "anonymous_bytes", lambda: held)
    fires: list[float] = []
    guard = SessionGuard(ACCESS, list, lambda: 0, lambda: fires.append(time.monotonic()))
    too_much = guard._holds_too_much  # pyright: ignore[reportPrivateUsage]
    held += MOST_HELD_BYTES + 1
    assert [too_much() for _ in range(3)] == [True, False, False]
    monkeypatch.setattr(session_guard, "HOLDING_PAUSE_S", 0.0)
    guard._again_s = 0.0  # pyright: ignore[reportPrivateUsage]
    held = 60 << 20
    assert not too_much()
    for _ in range(6):  # an attack each, after which memory comes back
        held = (50 << 20) + MOST_HELD_BYTES + 1
        assert too_much()
        held = 60 << 20
        assert not too_much()
    assert len(fires) == 7


def test_a_fifth_session_is_not_heard_for_a_while_and_then_shown_out(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Its client would connect anew at once, with all of TLS, hundreds of times a second."""
    monkeypatch.setattr(session_guard, "HELD_S", 1.0)
    monkeypatch.setattr(doorkeeper, "NEWCOMER_S", 0.2)
    ends = [linked() for _ in range(MOST_A_NAME + 1)]
    visitors: list[Visitor] = []
    with SessionGuard(ACCESS, lambda: list(visitors)):
        visitors += [visitor for _, _, visitor in ends[:-1]]
        time.sleep(0.3)
        ours, hers, fifth = ends[-1]
        visitors.append(fifth)
        hers.sendall(b"STOP")
        assert ours.recv(4) == b"STOP", "there is time for that"
        time.sleep(0.6)
        hers.sendall(b"anybody there?")
        ours.settimeout(0.2)
        with pytest.raises(TimeoutError):
            ours.recv(1)
        assert not is_shut(hers)
        for here, there, _ in ends[:-1]:
            there.sendall(b"news")
            assert here.recv(4) == b"news"
        assert until(lambda: is_shut(hers), 3)
        assert not any(is_shut(there) for _, there, _ in ends[:-1])
    for here, there, _ in ends:
        here.close()
        there.close()
