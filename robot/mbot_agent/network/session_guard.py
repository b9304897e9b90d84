"""Nobody keeps others from a STOP by taking up places, the processor or memory.

Zenoh admits whoever has a certificate of the fleet's authority, and drops what no rule allows, but
it keeps the session. Here those who have to go (doorkeeper) are shown out. Zenoh has no call to
close a session, so its socket is shut down, by the far end's address. A client that would reconnect
at once, 250 times a second with all of TLS, is first held for a while and not heard.

Nor by going without a word: as soon as a link is there its socket is told not to linger
(connected_sockets).
"""

import contextlib
import ctypes
import logging
import socket
import struct
import threading
import time
from collections.abc import Callable
from typing import Self

from mbot_agent.configuration import Access
from mbot_agent.network.doorkeeper import COME_AGAIN, LOOK_EVERY_S, Doorkeeper, Traffic, Visitor
from mbot_agent.network.health import anonymous_bytes
from mbot_protocol.wire.connected_sockets import Address, let_none_linger, with_socket

log = logging.getLogger(__name__)

MOST_HELD_BYTES = 64 << 20
"""More memory of its own than the daemon had when it was ready. A pushed model takes 2 MB until it
is stored; each declaration of a stranger's, denied or not, takes 1.3 kB and 38 bytes of wire."""

MOST_RAISED = 3
"""Times that the bar is raised by half of that when memory does not come back, up to 160 MB more
than at the beginning: with the 110 MB of a daemon that drives, below MemoryMax= of its unit."""

HOLDING_PAUSE_S = 10.0
"""Where memory does not come back all the same, nobody is to be shown out at every look."""

HELD_S = 2.0
MOST_VISITORS = 16
"""With more, nobody is held: Zenoh has 32 places."""

MOST_QUERIES = 300
"""A second, to the daemon in all, that are no flood: a fetch is 200 at most, hand commands and
pages that look are a few dozen."""

# Where these are in Linux's struct tcp_info (linux/tcp.h; the last since 4.9).
_BYTES_RECEIVED, _DATA_SEGMENTS_IN, _RECEIVER_LIMITED_US = 128, 152, 176


class SessionGuard:
    """The thread that looks, and shows out. A context manager; without certificates it shows
    nobody out.
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
        self._begun_bytes = anonymous_bytes()
        self._raised = 0
        self._again_s = 0.0
        self._held_since_s: dict[Visitor, float] = {}
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
                self._look()
                self._count()
            except OSError as error:
                log.debug("nobody was shown out: %s", error)

    def _look(self) -> None:
        sockets = let_none_linger()
        visitors = self._links() if self._shows_out else []
        if not visitors:
            return
        seen = [(one, _traffic(sockets.get(one.address), one.address)) for one in visitors]
        unwelcome = self._doorkeeper.unwelcome(seen, time.monotonic())
        if self._holds_too_much():
            unwelcome |= self._doorkeeper.hoarders(visitors)
        for visitor, why in unwelcome.items():
            try:
                self._turn_away(visitor, why, sockets.get(visitor.address), len(visitors))
            except OSError as error:  # gone meanwhile, and no excuse for the others
                log.debug("%s was not shown out: %s", visitor.name, error)
        held = self._held_since_s
        self._held_since_s = {one: held[one] for one in held if one in unwelcome}

    def _turn_away(self, visitor: Visitor, why: str, fd: int | None, visitors: int) -> None:
        if fd is None:
            log.error("%s %s, and its socket is not known", visitor.name, why)
        elif why not in COME_AGAIN or not self._is_held(visitor, fd, visitors):
            log.warning("%s %s: shown out", visitor.name, why)
            with_socket(fd, visitor.address, _shut)

    def _is_held(self, visitor: Visitor, fd: int, visitors: int) -> bool:
        """Whether it may not be heard and not go yet: begins with the first look at it."""
        since_s = self._held_since_s.setdefault(visitor, time.monotonic())
        if visitors > MOST_VISITORS or time.monotonic() - since_s >= HELD_S:
            return False
        with_socket(fd, visitor.address, _hear_nothing)
        return True

    def _holds_too_much(self) -> bool:
        """Whether memory has passed the bar, which comes down again with it."""
        over_bytes = anonymous_bytes() - self._begun_bytes - MOST_HELD_BYTES
        step_bytes = MOST_HELD_BYTES // 2
        if over_bytes < 0:
            self._raised = 0
        if over_bytes <= self._raised * step_bytes or time.monotonic() < self._again_s:
            return False
        self._raised = min(over_bytes // step_bytes + 1, MOST_RAISED)
        self._again_s = time.monotonic() + HOLDING_PAUSE_S
        self._under_fire()
        _give_back()
        return True

    def _count(self) -> None:
        """Once a second: is the daemon flooded?"""
        at_s, before = self._counted
        now_s, queries = time.monotonic(), self._queries()
        if now_s - at_s < 1.0:
            return
        self._counted = now_s, queries
        if queries - before > MOST_QUERIES * (now_s - at_s):
            self._under_fire()


def _traffic(fd: int | None, address: Address) -> Traffic:
    """What has gone over a socket."""
    if fd is None:
        return Traffic()
    try:
        info = with_socket(
            fd, address, lambda one: one.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, 192)
        )
        return Traffic(
            struct.unpack_from("Q", info, _BYTES_RECEIVED)[0],
            struct.unpack_from("I", info, _DATA_SEGMENTS_IN)[0],
            struct.unpack_from("Q", info, _RECEIVER_LIMITED_US)[0],
        )
    except (OSError, struct.error):
        return Traffic()


_NOTHING = ctypes.create_string_buffer(struct.pack("HBBI", 0x06, 0, 0, 0))
"""A classic BPF program: return 0, that is, keep nothing of what has come in."""
_ATTACH_FILTER, _DETACH_FILTER = 26, 27


def _hear_nothing(one: socket.socket) -> None:
    """Let the kernel drop what comes in; the far end only sees a link that is slow."""
    program = struct.pack("HxxxxxxP", 1, ctypes.addressof(_NOTHING))
    one.setsockopt(socket.SOL_SOCKET, _ATTACH_FILTER, program)


def _shut(one: socket.socket) -> None:
    with contextlib.suppress(OSError):  # it was heard all the time
        one.setsockopt(socket.SOL_SOCKET, _DETACH_FILTER, 0)
    one.shutdown(socket.SHUT_RDWR)


def _give_back() -> None:
    """What is free goes back to the kernel; else what was held for those who went would count."""
    with contextlib.suppress(AttributeError):  # another libc than glibc
        ctypes.CDLL(None).malloc_trim(0)
