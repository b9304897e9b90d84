"""The guard's thread on real sockets: this process holds both ends."""

import socket
import struct
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from mbot_agent.configuration import Access
from mbot_agent.network import doorkeeper, session_guard
from mbot_agent.network.doorkeeper import MOST_A_NAME, Visitor
from mbot_agent.network.health import anonymous_bytes
from mbot_agent.network.session_guard import (
    HELD_S,
    HOLDING_PAUSE_S,
    MOST_HELD_BYTES,
    MOST_QUERIES,
    MOST_RAISED,
    MOST_VISITORS,
    SessionGuard,
    _give_back,  # pyright: ignore[reportPrivateUsage]
)
from mbot_protocol.wire.keys import Right

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


FIN_WAIT2 = 5
"""This end was shut, and the other one knows (Linux's tcp_states.h)."""


def state(end: socket.socket) -> int:
    return end.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, 1)[0]


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


def test_one_that_is_just_gone_keeps_no_other_from_being_shown_out(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ours, hers, gone = linked()
    here, there, stays = linked()
    with_socket = session_guard.with_socket

    def fails_for_one(fd: int, address: tuple[str, int], act: Any) -> Any:
        if address == gone.address:
            raise ConnectionResetError
        return with_socket(fd, address, act)

    monkeypatch.setattr(session_guard, "with_socket", fails_for_one)
    strangers = [replace(one, name="person:nick") for one in (gone, stays)]
    with SessionGuard(ACCESS, lambda: strangers), ours, hers, here, there:
        assert until(lambda: is_shut(there), 3)


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


class Turned:
    """A guard that looks when it is told to, at a clock and a memory that the test turns."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_s = 1000.0
        self.held = 50 << 20
        self.queries = 0
        self.fires: list[float] = []
        self.given_back = 0
        monkeypatch.setattr(session_guard.time, "monotonic", lambda: self.now_s)
        monkeypatch.setattr(session_guard, "anonymous_bytes", lambda: self.held)
        monkeypatch.setattr(session_guard, "_give_back", self._give_back)
        self.guard: Any = SessionGuard(
            ACCESS, list, lambda: self.queries, lambda: self.fires.append(self.now_s)
        )

    def _give_back(self) -> None:
        self.given_back += 1

    def holds(self, more_bytes: int) -> bool:
        """Whether so much more than at the beginning, and the bar, is too much."""
        self.held = (50 << 20) + MOST_HELD_BYTES + more_bytes
        return self.guard._holds_too_much()


@pytest.fixture
def turned(monkeypatch: pytest.MonkeyPatch) -> Turned:
    return Turned(monkeypatch)


def test_memory_that_does_not_come_back_is_no_lock_out(turned: Turned) -> None:
    step = MOST_HELD_BYTES // 2
    assert [turned.holds(0), turned.holds(1)] == [False, True]
    turned.now_s += HOLDING_PAUSE_S - 0.1
    assert not turned.holds(10 * step)
    turned.now_s += 0.1
    assert [turned.holds(step), turned.holds(step + 1)] == [False, True]
    for more in range(2, 9):  # it rises, and so does the bar, but for so often
        turned.now_s += HOLDING_PAUSE_S
        assert turned.holds(more * step + 1)
        turned.now_s += HOLDING_PAUSE_S
        assert turned.holds(more * step + 1) == (more >= MOST_RAISED)
    assert turned.given_back == len(turned.fires)


def test_memory_that_came_back_lowers_the_bar(turned: Turned) -> None:
    for _ in range(6):  # an attack each
        turned.now_s += HOLDING_PAUSE_S
        assert turned.holds(1)
        turned.now_s += HOLDING_PAUSE_S
        assert not turned.holds(0)
        assert not turned.holds(1)
        assert not turned.holds(-1)
    assert len(turned.fires) == turned.given_back == 6


def test_who_is_alone_with_its_memory_is_not_under_fire(turned: Turned) -> None:
    turned.held += 2 * MOST_HELD_BYTES
    turned.guard._look()
    assert turned.fires == []


def test_a_flood_is_more_queries_a_second_than_anybody_needs(turned: Turned) -> None:
    def after(seconds: float, queries: int) -> int:
        turned.now_s += seconds
        turned.queries += queries
        turned.guard._count()
        return len(turned.fires)

    assert after(1.0, MOST_QUERIES) == 0
    assert after(2.0, 2 * MOST_QUERIES) == 0
    assert after(0.75, MOST_QUERIES) == 0
    assert after(0.25, 1) == 1
    assert after(1.0, 0) == 1


def test_freed_memory_goes_back_to_the_kernel() -> None:
    """What lies above it in glibc's pool keeps it from going by itself."""
    block = 100_000  # below what glibc takes from the kernel piece by piece
    pieces = [bytearray(block) for _ in range(600)]
    full = anonymous_bytes()
    del pieces[:-1]
    _give_back()
    assert anonymous_bytes() < full - 300 * block


def test_with_many_here_nobody_is_kept_waiting_to_go(turned: Turned) -> None:
    ours, hers, visitor = linked()
    is_held = turned.guard._is_held
    with ours, hers:
        fd = ours.fileno()
        assert is_held(visitor, fd, MOST_VISITORS)
        assert not is_held(visitor, fd, MOST_VISITORS + 1)
        turned.now_s += HELD_S - 0.1
        assert is_held(visitor, fd, 1)
        turned.now_s += 0.1
        assert not is_held(visitor, fd, 1)
        turned.guard._links = lambda: [Visitor("person:vera", ("10.0.0.7", 1), "another")]
        turned.guard._look()
        assert turned.guard._held_since_s == {}


def test_a_fifth_session_is_not_heard_for_a_while_and_then_shown_out(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Its client would reconnect at once, with all of TLS, hundreds of times a second."""
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
        assert until(lambda: state(ours) == FIN_WAIT2, 3), "heard again: it goes in peace"
        assert not any(is_shut(there) for _, there, _ in ends[:-1])
    for here, there, _ in ends:
        here.close()
        there.close()
