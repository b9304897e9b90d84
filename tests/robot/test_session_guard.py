"""The guard's thread on real sockets: this process holds both ends."""

import socket
import time
from contextlib import suppress

import pytest

from mbot_agent.configuration import Access
from mbot_agent.network import session_guard
from mbot_agent.network.doorkeeper import Visitor
from mbot_agent.network.session_guard import MOST_QUERIES, SessionGuard
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


def test_who_floods_is_shown_out() -> None:
    ours, hers, visitor = linked()
    with SessionGuard(ACCESS, lambda: [visitor]):
        time.sleep(0.15)  # it has looked once
        hers.sendall(bytes(100_000))
        assert until(lambda: is_shut(hers), 3)
    ours.close()
    hers.close()


def test_a_flood_is_told_of_and_a_few_questions_are_not() -> None:
    told: list[float] = []
    asked = 0
    with SessionGuard(Access(), list, lambda: asked, lambda: told.append(time.monotonic())):
        for each, fires in ((MOST_QUERIES // 2, False), (3 * MOST_QUERIES, True)):
            end_s = time.monotonic() + 2.5
            while time.monotonic() < end_s:
                asked += each // 10
                time.sleep(0.1)
            assert bool(told) is fires


def test_who_makes_the_daemon_hold_too_much_is_shown_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever it is that is held: here pages that this process really takes."""
    monkeypatch.setattr(session_guard, "MOST_HELD_BYTES", 32 << 20)
    ours, hers, visitor = linked()
    with SessionGuard(ACCESS, lambda: [visitor]):
        time.sleep(0.5)
        assert not is_shut(hers)
        held = b"x" * (48 << 20)
        assert until(lambda: is_shut(hers), 3)
        assert len(held) > 0
    ours.close()
    hers.close()
