"""Who may stay connected: nobody keeps others from a STOP by taking up places or the processor.

Zenoh admits whoever has a certificate of the fleet's authority, and drops what no rule allows, but
it keeps the session. Here people who are not on the roll are shown out at once, one name gets a few
places, and who may only look and floods the robot is shown out for a while. Zenoh has no call to
close a session, so its socket is shut down, by the far end's address.
"""

import logging
import os
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Self

from mbot_agent.configuration import Access
from mbot_protocol.access_rules import Kind, common_name
from mbot_protocol.keys import Right

log = logging.getLogger(__name__)

LOOK_EVERY_S = 0.1

MOST_A_NAME = 4
"""Sessions: telemetry, a recording, a command, and one that has not been given up yet."""

LARGEST_RATE = 100_000
"""Bytes a second from who may only look or drive: 20 hand commands a second are 4,000. A push sends
megabytes, so who may push is not counted."""

BANNED_S = 30.0

_TCP_INFO_BYTES_RECEIVED = 128
"""Where tcpi_bytes_received is in Linux's struct tcp_info (linux/tcp.h, since 4.1)."""


@dataclass(frozen=True, slots=True)
class Visitor:
    """One link.

    Attributes:
        name: the common name of the certificate; None: plain TCP, from this machine.
        address: the far end's host and port.
        session: its identifier.

    """

    name: str | None
    address: tuple[str, int]
    session: str


class Doorkeeper:
    """Decides who has to go; pure but for the time that is passed in."""

    def __init__(self, access: Access) -> None:
        people = {
            common_name(Kind.PERSON, name): frozenset(rights)
            for name, rights in access.people.items()
        }
        self._rights: dict[str, frozenset[Right]] = people
        self._routers = {common_name(Kind.ROUTER, name) for name in access.routers}
        self._since_s: dict[Visitor, float] = {}
        self._received: dict[Visitor, tuple[float, int]] = {}
        self._banned_until_s: dict[str, float] = {}

    def unwelcome(
        self, visitors: Iterable[tuple[Visitor, int]], now_s: float
    ) -> dict[Visitor, str]:
        """Those who have to go, and why.

        Args:
            visitors: all there are, with the bytes that each has sent so far.
            now_s: monotonic.

        """
        here = dict(visitors)
        self._since_s = {one: self._since_s.get(one, now_s) for one in here}
        found: dict[Visitor, str] = {}
        of_a_name: dict[str, int] = {}
        for visitor in sorted(here, key=lambda one: self._since_s[one]):
            name = visitor.name
            if name is None or name in self._routers:
                continue
            if name not in self._rights:
                found[visitor] = "is not on this robot's roll"
            elif self._floods(visitor, here[visitor], now_s):
                found[visitor] = f"floods the robot, and may come again in {BANNED_S:.0f} s"
            else:
                of_a_name[name] = of_a_name.get(name, 0) + 1
                if of_a_name[name] > MOST_A_NAME:
                    found[visitor] = f"has {MOST_A_NAME} sessions already"
        self._received = {one: seen for one, seen in self._received.items() if one in here}
        return found

    def _floods(self, visitor: Visitor, received: int, now_s: float) -> bool:
        assert visitor.name is not None
        if self._banned_until_s.get(visitor.name, 0.0) > now_s:
            return True
        before = self._received.get(visitor)
        if before is None:
            self._received[visitor] = now_s, received
            return False
        seen_s, then = before
        if now_s - seen_s < LOOK_EVERY_S / 2:
            return False
        self._received[visitor] = now_s, received
        too_fast = (received - then) / (now_s - seen_s) > LARGEST_RATE
        if too_fast and Right.PUSH not in self._rights[visitor.name]:
            self._banned_until_s[visitor.name] = now_s + BANNED_S
            return True
        return False


class SessionGuard:
    """The thread that looks, and shows out. A context manager; idle without certificates."""

    def __init__(self, access: Access, links: Callable[[], list[Visitor]]) -> None:
        """`links` are those there are now; it must return at once."""
        self._doorkeeper = Doorkeeper(access)
        self._needed = bool(access.people or access.routers)
        self._links = links
        self._closing = False
        self._news = threading.Event()
        self._thread = threading.Thread(target=self._run, name="sessions", daemon=True)

    def __enter__(self) -> Self:
        if self._needed:
            self._thread.start()
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        self._closing = True
        self._news.set()
        if self._needed:
            self._thread.join(timeout=1.0)

    def look_now(self) -> None:
        """Somebody has come or gone; any thread may say so."""
        self._news.set()

    def _run(self) -> None:
        while not self._closing:
            self._news.wait(LOOK_EVERY_S)
            self._news.clear()
            try:
                self._look()
            except OSError as error:
                log.debug("nobody was shown out: %s", error)

    def _look(self) -> None:
        visitors = self._links()
        if not visitors:
            return
        sockets = _sockets()
        counted = [(one, _received(sockets.get(one.address))) for one in visitors]
        for visitor, why in self._doorkeeper.unwelcome(counted, time.monotonic()).items():
            log.warning("%s %s: shown out", visitor.name, why)
            if (fd := sockets.get(visitor.address)) is not None:
                _with_socket(fd, lambda one: one.shutdown(socket.SHUT_RDWR))


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


def _received(fd: int | None) -> int:
    """Bytes that have come in on a socket."""
    if fd is None:
        return 0
    try:
        info = _with_socket(
            fd, lambda one: one.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, 192)
        )
        return struct.unpack_from("Q", info, _TCP_INFO_BYTES_RECEIVED)[0]
    except (OSError, struct.error):
        return 0


def _with_socket(fd: int, act: Callable[[socket.socket], Any]) -> Any:
    """Do something with a socket that belongs to Zenoh, and leave it open."""
    one = socket.socket(fileno=os.dup(fd))
    try:
        return act(one)
    finally:
        one.close()
