"""Nobody keeps others from a STOP by taking up places, the processor or memory.

Zenoh admits whoever has a certificate of the fleet's authority, and drops what no rule allows, but
it keeps the session. Here those who have to go (doorkeeper) are shown out. Zenoh has no call to
close a session, so its socket is shut down, by the far end's address.
"""

import logging
import os
import socket
import struct
import threading
import time
from collections.abc import Callable
from typing import Any, Self

from mbot_agent.configuration import Access
from mbot_agent.network.doorkeeper import LOOK_EVERY_S, Doorkeeper, Traffic, Visitor
from mbot_agent.network.health import anonymous_bytes

log = logging.getLogger(__name__)

MOST_HELD_BYTES = 64 << 20
"""More memory of its own than the daemon had when it was ready. A pushed model takes 2 MB until it
is stored; each declaration of a stranger's, denied or not, takes 1.3 kB and 38 bytes of wire."""

MOST_QUERIES = 300
"""A second, to the daemon in all, that are no flood: a fetch is 200 at most, hand commands and
pages that look are a few dozen."""

# Where these are in Linux's struct tcp_info (linux/tcp.h; the last since 4.9).
_BYTES_RECEIVED, _DATA_SEGMENTS_IN, _RECEIVER_LIMITED_US = 128, 152, 176


class SessionGuard:
    """The thread that looks, and shows out. A context manager; without certificates it only tells
    of floods.
    """

    def __init__(
        self,
        access: Access,
        links: Callable[[], list[Visitor]],
        queries: Callable[[], int] = lambda: 0,
        under_fire: Callable[[], None] = lambda: None,
    ) -> None:
        """Prepare the thread.

        Args:
            access: who may do what.
            links: those there are now; it must return at once.
            queries: how many have come in so far.
            under_fire: told now and then while somebody floods the daemon.

        """
        self._doorkeeper = Doorkeeper(access)
        self._shows_out = bool(access.people or access.routers)
        self._links = links
        self._queries = queries
        self._under_fire = under_fire
        self._counted = time.monotonic(), 0
        self._most_bytes = anonymous_bytes() + MOST_HELD_BYTES
        self._closing = False
        self._news = threading.Event()
        self._thread = threading.Thread(target=self._run, name="sessions", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        self._closing = True
        self._news.set()
        self._thread.join(timeout=1.0)

    def look_now(self) -> None:
        """Somebody has come or gone; any thread may say so."""
        self._news.set()

    def _run(self) -> None:
        while not self._closing:
            self._news.wait(LOOK_EVERY_S if self._shows_out else 1.0)
            self._news.clear()
            try:
                if self._shows_out:
                    self._look()
                self._count()
            except OSError as error:
                log.debug("nobody was shown out: %s", error)

    def _look(self) -> None:
        visitors = self._links()
        if not visitors:
            return
        sockets = _sockets()
        seen = [(one, _traffic(sockets.get(one.address))) for one in visitors]
        unwelcome = self._doorkeeper.unwelcome(seen, time.monotonic())
        if (held_bytes := anonymous_bytes()) > self._most_bytes:
            self._most_bytes = held_bytes + MOST_HELD_BYTES // 2
            unwelcome |= self._doorkeeper.hoarders(seen, time.monotonic())
        for visitor, why in unwelcome.items():
            log.warning("%s %s: shown out", visitor.name, why)
            if (fd := sockets.get(visitor.address)) is not None:
                _with_socket(fd, lambda one: one.shutdown(socket.SHUT_RDWR))

    def _count(self) -> None:
        """Once a second: is the daemon flooded?"""
        at_s, before = self._counted
        now_s, queries = time.monotonic(), self._queries()
        if now_s - at_s < 1.0:
            return
        self._counted = now_s, queries
        if queries - before > MOST_QUERIES * (now_s - at_s):
            self._under_fire()


def _sockets() -> dict[tuple[str, int], int]:
    """This process's connected TCP sockets, by the far end's address."""
    found: dict[tuple[str, int], int] = {}
    for name in os.listdir("/proc/self/fd"):  # noqa: PTH208 (no Path for each of 8,192)
        try:
            if os.readlink(f"/proc/self/fd/{name}").startswith("socket:"):  # noqa: PTH115
                address = _with_socket(int(name), lambda one: one.getpeername())
                if isinstance(address, tuple):
                    found[address[0], address[1]] = int(name)
        except OSError:
            continue  # closed meanwhile, or not connected
    return found


def _traffic(fd: int | None) -> Traffic:
    """What has gone over a socket."""
    if fd is None:
        return Traffic()
    try:
        info = _with_socket(
            fd, lambda one: one.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, 192)
        )
        return Traffic(
            struct.unpack_from("Q", info, _BYTES_RECEIVED)[0],
            struct.unpack_from("I", info, _DATA_SEGMENTS_IN)[0],
            struct.unpack_from("Q", info, _RECEIVER_LIMITED_US)[0],
        )
    except (OSError, struct.error):
        return Traffic()


def _with_socket(fd: int, act: Callable[[socket.socket], Any]) -> Any:
    """Do something with a socket that belongs to Zenoh, and leave it open."""
    one = socket.socket(fileno=os.dup(fd))
    try:
        return act(one)
    finally:
        one.close()
