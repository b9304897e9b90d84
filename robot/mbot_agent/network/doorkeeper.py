"""Who may stay connected: pure, but for the time that is passed in.

People who are not on the roll go at once, one name has a few places, and who floods the robot, does
not read what it is sent, or makes the daemon hold more and more for them is shown out.
"""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

from mbot_agent.configuration import Access
from mbot_protocol.wire.access_rules import Kind, common_name
from mbot_protocol.wire.keys import Right

LOOK_EVERY_S = 0.1

MOST_A_NAME = 4
"""Sessions: telemetry, a recording, a command, and one that has not been given up yet."""

NEWCOMER_S = 1.0
"""A fifth may stay so long: enough for a `workstation stop` in one terminal more."""

LARGEST_RATE = 100_000
"""Bytes a second from who may only look or drive: 20 hand commands a second are 4,000. A push sends
megabytes, so who may push is not counted."""

MOST_MESSAGES = 400
"""A second, of all sessions of a name, with a burst of one second's: segments of TCP with something
in them. Who fetches a recording asks 200 times a second at most (recording_fetch)."""

UNREAD_SHARE = 0.8
"""Of the time between two looks in which the far end had no room: it does not read."""

DEAF_LOOKS = 2
"""In a row, until somebody counts as not reading: one may be a busy workstation."""

MOST_UNREAD = 2
"""Times within `UNREAD_WITHIN_S` that a name's sessions may be shown out for that: a workstation
that was put to sleep and wakes up has one; who does it again and again wants to hold others up."""

UNREAD_WITHIN_S = 60.0

BANNED_S = 30.0

SURPLUS = f"has {MOST_A_NAME} sessions already"
BANNED = "is to stay away for a while"
COME_AGAIN = (SURPLUS, BANNED)
"""Whose client reconnects at once: it is to be held for a while, not turned away."""


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


@dataclass(frozen=True, slots=True)
class Traffic:
    """Of one link, since it was opened.

    Attributes:
        received_bytes: that have come in.
        received_segments: pieces that these came in, at least one a message.
        unread_us: for how long something waited for room in the far end's buffers.

    """

    received_bytes: int = 0
    received_segments: int = 0
    unread_us: int = 0


class Doorkeeper:
    """Decides who has to go."""

    def __init__(self, access: Access) -> None:
        people = {
            common_name(Kind.PERSON, name): frozenset(rights)
            for name, rights in access.people.items()
        }
        self._rights: dict[str, frozenset[Right]] = people
        self._routers = {common_name(Kind.ROUTER, name) for name in access.routers}
        self._since_s: dict[Visitor, float] = {}
        self._before: dict[Visitor, tuple[float, Traffic]] = {}
        self._deaf_looks: dict[Visitor, int] = {}
        self._level: dict[str, tuple[float, float]] = {}
        self._unread_s: dict[str, list[float]] = {}
        self._banned_until_s: dict[str, float] = {}

    def unwelcome(
        self, visitors: Iterable[tuple[Visitor, Traffic]], now_s: float
    ) -> dict[Visitor, str]:
        """Those who have to go, and why.

        Args:
            visitors: all there are.
            now_s: monotonic.

        """
        here = dict(visitors)
        self._since_s = {one: self._since_s.get(one, now_s) for one in here}
        found: dict[Visitor, str] = {}
        of_a_name: Counter[str] = Counter()
        for visitor in sorted(here, key=lambda one: self._since_s[one]):
            name = visitor.name
            if name is None or name in self._routers:
                continue
            if name not in self._rights:
                found[visitor] = "is not on this robot's roll"
            elif of_a_name[name] >= MOST_A_NAME + self._is_new(visitor, now_s):
                # Nothing else is held against it: who opens a fifth window has to keep the four.
                found[visitor] = SURPLUS
            elif why := self._misbehaves(visitor, name, here[visitor], now_s):
                found[visitor] = why
            else:
                of_a_name[name] += 1
        self._before = {one: seen for one, seen in self._before.items() if one in here}
        self._deaf_looks = {one: n for one, n in self._deaf_looks.items() if one in here}
        return found

    def hoarders(self, visitors: Iterable[Visitor]) -> dict[Visitor, str]:
        """Who has to go when the daemon holds too much: all who may only look or drive, which ends
        what it holds for them.

        Nobody tells how much is held for whom, so nobody is kept away for it: whoever means no harm
        reconnects by itself.
        """
        return {
            visitor: "may hold too much of the daemon's memory"
            for visitor in visitors
            if visitor.name in self._rights and Right.PUSH not in self._rights[visitor.name]
        }

    def _is_new(self, visitor: Visitor, now_s: float) -> bool:
        return now_s - self._since_s[visitor] < NEWCOMER_S

    def _misbehaves(self, visitor: Visitor, name: str, traffic: Traffic, now_s: float) -> str:
        """Why this one has to go, if so."""
        if self._banned_until_s.get(name, 0.0) > now_s:
            return BANNED
        seen_s, then = self._before.get(visitor, (now_s, Traffic()))
        if visitor in self._before and now_s - seen_s < LOOK_EVERY_S / 2:
            return ""
        self._before[visitor] = now_s, traffic
        if now_s == seen_s:  # the first look: a handshake is no message
            then = traffic
        if self._does_not_read(visitor, traffic.unread_us - then.unread_us, now_s - seen_s):
            if self._deaf_looks[visitor] == DEAF_LOOKS:  # it may be here for some looks more
                times = [at for at in self._unread_s.get(name, []) if now_s - at < UNREAD_WITHIN_S]
                self._unread_s[name] = [*times, now_s]
                if len(times) >= MOST_UNREAD:
                    self._banned_until_s[name] = now_s + BANNED_S
            return "does not read what it is sent"
        too_fast = traffic.received_bytes - then.received_bytes > LARGEST_RATE * (now_s - seen_s)
        messages = traffic.received_segments - then.received_segments
        received = traffic.received_bytes - then.received_bytes
        too_much = self._too_much(name, messages, received, now_s)
        if (too_fast or too_much) and Right.PUSH not in self._rights[name]:
            self._banned_until_s[name] = now_s + BANNED_S
            return f"floods the robot, and may come again in {BANNED_S:.0f} s"
        return ""

    def _does_not_read(self, visitor: Visitor, unread_us: int, passed_s: float) -> bool:
        """Whether it has not for some looks in a row."""
        deaf = passed_s > 0 and unread_us >= UNREAD_SHARE * passed_s * 1e6
        looks = self._deaf_looks.get(visitor, 0) + 1 if deaf else 0
        self._deaf_looks[visitor] = looks
        return looks >= DEAF_LOOKS

    def _too_much(self, name: str, messages: int, received_bytes: int, now_s: float) -> bool:
        """A bucket a name that leaks what may come in a second; many small messages may come in
        one piece, and then their bytes tell."""
        level, at_s = self._level.get(name, (0.0, now_s))
        share = max(messages / MOST_MESSAGES, received_bytes / LARGEST_RATE)
        level = max(0.0, level - (now_s - at_s)) + share
        self._level[name] = level, now_s
        return level > 1.0
