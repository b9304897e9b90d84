import os
import socket
import struct
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from mbot_protocol.wire.connected_sockets import let_none_linger, with_socket

LINGERS = struct.pack("ii", 1, 10)


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


def pair(stack: ExitStack, host: str = "127.0.0.1") -> tuple[socket.socket, socket.socket]:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.create_server((host, 0), family=family) as server:
        near = stack.enter_context(socket.create_connection(server.getsockname()[:2]))
        far, _ = server.accept()
    return near, stack.enter_context(far)


def lingers(one: socket.socket) -> bool:
    on, _ = struct.unpack("ii", one.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, 8))
    return bool(on)


@pytest.mark.parametrize("host", ["127.0.0.1", "::1"])
def test_connected_sockets_are_found_by_the_far_end_and_linger_no_more(
    stack: ExitStack, host: str
) -> None:
    near, _ = pair(stack, host)
    near.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, LINGERS)
    assert lingers(near)
    found = let_none_linger()
    assert found[near.getpeername()[:2]] == near.fileno()
    assert not lingers(near)


def test_other_descriptors_are_left_alone_and_none_is_lost(stack: ExitStack) -> None:
    for one in (*socket.socketpair(), socket.socket(), *map(os.fdopen, os.pipe())):
        stack.enter_context(one)
    assert None not in let_none_linger()
    before = list(Path("/proc/self/fd").iterdir())
    let_none_linger()
    assert list(Path("/proc/self/fd").iterdir()) == before


def test_what_is_done_to_a_socket_leaves_it_open(stack: ExitStack) -> None:
    near, far = pair(stack)
    assert with_socket(near.fileno(), far.getsockname(), lambda one: one.send(b"news")) == 4
    assert far.recv(4) == b"news"
    near.sendall(b"more")
    assert far.recv(4) == b"more"


def test_nothing_is_done_to_a_descriptor_that_is_somebody_elses_by_now(stack: ExitStack) -> None:
    near, far = pair(stack)
    other, _ = pair(stack)
    asked: list[socket.socket] = []
    for fd in (other.fileno(), stack.enter_context(socket.socket()).fileno(), 0, 9999):
        with pytest.raises(OSError):  # noqa: PT011 (which one is the kernel's choice)
            with_socket(fd, far.getsockname(), asked.append)
    assert asked == []
    assert near.fileno() >= 0
