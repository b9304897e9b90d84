"""The TCP sockets of this process, for what Zenoh has no call for.

Zenoh has its sockets linger: closing one waits up to 10 s for a far end that acknowledges nothing,
a laptop that was shut or a robot without a battery, and one of the two threads that hear everybody
waits with it. With both waiting no STOP gets through to anybody (measured with 1.10.2).
"""

import os
import socket
import struct
import sys
from collections.abc import Callable
from typing import TypeVar

Address = tuple[str, int]
"""Host, without an interface, and port."""

Found = TypeVar("Found")

_DESCRIPTORS = "/proc/self/fd" if sys.platform == "linux" else "/dev/fd"
_CLOSE_AT_ONCE = struct.pack("ii", 0, 0)


def let_none_linger() -> dict[Address, int]:
    """See to it that no close is waited for; the sockets' descriptors by the far end's address.

    What was sent still goes out after a close, and nobody waits for it.
    """
    found: dict[Address, int] = {}
    for name in os.listdir(_DESCRIPTORS):  # noqa: PTH208 (no Path for each of 8,192)
        try:
            with _duplicate(int(name)) as one:
                if (address := _far_end(one)) is not None:
                    one.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _CLOSE_AT_ONCE)
                    found[address] = int(name)
        except OSError:
            continue  # no socket, not connected, or closed meanwhile
    return found


def with_socket(fd: int, address: Address, act: Callable[[socket.socket], Found]) -> Found:
    """Do something with a socket that belongs to somebody else, and leave it open.

    Raises:
        OSError: it is gone, or is connected with somebody else by now.

    """
    with _duplicate(fd) as one:
        if _far_end(one) != address:
            raise ConnectionResetError(f"the connection with {address[0]} is gone")
        return act(one)


def _duplicate(fd: int) -> socket.socket:
    own = os.dup(fd)
    try:
        return socket.socket(fileno=own)
    except OSError:  # no socket
        os.close(own)
        raise


def _far_end(one: socket.socket) -> Address | None:
    if one.family not in (socket.AF_INET, socket.AF_INET6):
        return None
    host, port, *_ = one.getpeername()
    return host.partition("%")[0], port
