"""A dead man's switch over a network: who holds, and is its last word still good?

Pure but for what it remembers; the clock is handed in.
"""

from collections import defaultdict
from dataclasses import dataclass
from typing import Protocol

import msgspec


@dataclass(frozen=True, slots=True)
class Wish:
    """As of now.

    Attributes:
        wheels: left and right in [-1, 1] while the hand holds; None while it does not.
        stop: STOP was asked for since the last wish.
        run: the policy was asked to drive since the last wish.
        mark: what the robot has just done was wrong, it was said since the last wish.
        end: nothing more will come: asked to end, or the device is gone.

    """

    wheels: tuple[float, float] | None = None
    stop: bool = False
    run: bool = False
    end: bool = False
    mark: bool = False


class HandInput(Protocol):
    """A device that a hand holds."""

    def read(self, wait_s: float) -> Wish:
        """Wait so long for something to happen, and say what is wanted then."""
        ...


def mixed(ahead: float, turn: float) -> tuple[float, float]:
    """Wheels in [-1, 1] from how much ahead and how much to the right, each in [-1, 1]."""
    left, right = ahead + turn, ahead - turn
    most = max(1.0, abs(left), abs(right))
    return left / most, right / most


FRESH_S = 0.25
"""The page repeats every 0.1 s; after two that did not come the hand counts as gone."""

HELD_UP_S = 0.25
"""A repeat that took so much longer than the fastest one is old news: it may come in a heap of
them, after a tunnel that hung, and the hand long since be gone."""


class HandRepeat(msgspec.Struct, frozen=True, tag_field="do", tag="hand"):
    """A hand still holds: said every 0.1 s while a key, a button or a finger is down.

    Attributes:
        press: counts the times that this owner has taken hold.
        left, right: wheels in [-1, 1], 1 is full speed forward.
        seen_stops: the robot's stop counter as the person has been shown it.
        sent_s: the owner's monotonic clock.

    """

    press: int
    left: float
    right: float
    seen_stops: int
    sent_s: float

    def __post_init__(self) -> None:
        for name, wheel in (("left", self.left), ("right", self.right)):
            if not -1 <= wheel <= 1:
                raise ValueError(f"{name} is {wheel}, expected a number in [-1, 1]")


@dataclass(frozen=True, slots=True)
class Grip:
    """A hand that holds.

    Attributes:
        owner: which page.
        press: which of the times that it took hold.
        left, right: wheels in [-1, 1].
        seen_stops: the stop counter that the person saw on taking hold.
        arrived_s: when the newest repeat came, on this machine's monotonic clock.

    """

    owner: int
    press: int
    left: float
    right: float
    seen_stops: int
    arrived_s: float

    def is_same_press(self, other: "Grip | None") -> bool:
        """Whether it is the same hand, without having let go in between."""
        return other is not None and (self.owner, self.press) == (other.owner, other.press)


class Hand:
    """At most one hand at a time. What has ended holds again only by a new press."""

    def __init__(self) -> None:
        self._grip: Grip | None = None
        self._over: defaultdict[int, int] = defaultdict(int)
        self._fastest_s: dict[int, float] = {}

    def repeat(self, owner: int, said: HandRepeat, now_s: float) -> str:
        """A page says that it holds. Returns why that counts for nothing; empty if it counts."""
        travel_s = now_s - said.sent_s
        fastest_s = min(travel_s, self._fastest_s.get(owner, travel_s))
        self._fastest_s[owner] = fastest_s
        held = self.held(now_s)
        if held is not None and held.owner != owner:
            self._over[owner] = max(said.press, self._over[owner])
            return "somebody else drives by hand now"
        if said.press <= self._over[owner]:
            return "let go first, then take hold again"
        if travel_s - fastest_s > HELD_UP_S:
            return f"held up for {travel_s - fastest_s:.1f} s on its way"
        if held is not None and said.press == held.press:
            seen_stops = held.seen_stops
        else:
            self.let_go(owner)
            seen_stops = said.seen_stops
        self._grip = Grip(owner, said.press, said.left, said.right, seen_stops, now_s)
        return ""

    def held(self, now_s: float) -> Grip | None:
        """The hand that holds now; one that was silent for too long has let go."""
        if self._grip is not None and now_s - self._grip.arrived_s > FRESH_S:
            self.let_go(self._grip.owner)
        return self._grip

    def let_go(self, owner: int, press: int | None = None) -> None:
        """A page lets go: of this press and those before; of whatever it holds, if not given."""
        held = self._grip if self._grip is not None and self._grip.owner == owner else None
        ended = press if press is not None else held.press if held is not None else 0
        self._over[owner] = max(ended, self._over[owner])
        if held is not None and held.press <= ended:
            self._grip = None

    def let_all_go(self) -> None:
        """Nobody holds any more, until somebody takes hold again."""
        if self._grip is not None:
            self.let_go(self._grip.owner)

    def forget(self, owner: int) -> None:
        """A page is gone for good."""
        self.let_go(owner)
        self._over.pop(owner, None)
        self._fastest_s.pop(owner, None)
