"""Keys in a terminal: held as long as they repeat.

A terminal tells of no key that is let go. So a key counts as held from its first repetition on, and
until that stays away: half a second late to begin, and never driving on by a mere tap.
"""

import os
import select
import sys
import termios
import time
import tty
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Self

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.fleet.by_hand.hand import Wish

FIRST_REPEAT_WITHIN_S = 0.8
"""Keyboards begin to repeat after 0.25 to 0.66 s."""

HELD_FOR_S = 0.2
"""They repeat 10 to 33 times a second; with 10 two may be lost on the way over ssh."""

HELD_UP_WITHIN_S = 0.008
"""Half of what the fastest keyboards are set to (60 a second). Keys that come closer together were
held up on their way: they say what the hand did then, not what it does now."""

WAYS = {
    "w": (1.0, 1.0),
    "s": (-1.0, -1.0),
    "a": (-0.6, 0.6),
    "d": (0.6, -0.6),
    "\x1b[A": (1.0, 1.0),
    "\x1b[B": (-1.0, -1.0),
    "\x1b[D": (-0.6, 0.6),
    "\x1b[C": (0.6, -0.6),
}
STOP, RUN, MARK, END = " ", "r", "m", "q"


class KeyRepeats:
    """Which key is held, by the times at which it came."""

    def __init__(self, speed: float) -> None:
        """`speed`: of the faster wheel, in [0, 1]."""
        self._speed = speed
        self._key = ""
        self._came_s = 0.0
        self._held = False
        self._held_up = False

    def take(self, key: str, now_s: float) -> None:
        """A key has come."""
        again = key == self._key
        within_s = HELD_FOR_S if self._held else FIRST_REPEAT_WITHIN_S
        since_s = now_s - self._came_s
        held_up = again and since_s < HELD_UP_WITHIN_S
        self._held = again and not (held_up or self._held_up) and since_s <= within_s
        self._key, self._came_s, self._held_up = key, now_s, held_up

    def wheels(self, now_s: float) -> tuple[float, float] | None:
        """What the held key wants; None while none is held."""
        if not self._held or now_s - self._came_s > HELD_FOR_S or self._key not in WAYS:
            return None
        left, right = WAYS[self._key]
        return self._speed * left, self._speed * right


def split_keys(text: str) -> list[str]:
    """Single keys; an arrow is three characters."""
    keys: list[str] = []
    while text:
        length = 3 if text[:3] in WAYS else 1
        keys.append(text[:length])
        text = text[length:]
    return keys


class TerminalKeys:
    """A terminal's keyboard, key by key: a `HandInput`. A context manager."""

    def __init__(
        self,
        speed: float,
        terminal: int | None = None,
        monotonic_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._terminal = sys.stdin.fileno() if terminal is None else terminal
        self._repeats = KeyRepeats(speed)
        self._monotonic_s = monotonic_s
        self._before: list[Any] = []

    def __enter__(self) -> Self:
        """Begin to read single keys.

        Raises:
            ConfigurationError: there is no terminal.

        """
        if not os.isatty(self._terminal):
            raise ConfigurationError("--keyboard needs a terminal to read keys from")
        self._before = termios.tcgetattr(self._terminal)
        tty.setcbreak(self._terminal)
        return self

    def __exit__(self, *_: object) -> None:
        with suppress(termios.error):  # it may be gone
            termios.tcsetattr(self._terminal, termios.TCSADRAIN, self._before)

    def read(self, wait_s: float) -> Wish:
        """As `HandInput`; the end on `q`, or once the terminal is closed."""
        try:
            ready, _, _ = select.select([self._terminal], [], [], wait_s)
            data = os.read(self._terminal, 256) if ready else b""
        except OSError:
            return Wish(end=True)
        keys = split_keys(data.decode("ascii", errors="replace"))
        now_s = self._monotonic_s()
        for key in keys:
            self._repeats.take(key, now_s)
        over = END in keys or (bool(ready) and not data)
        return Wish(self._repeats.wheels(now_s), STOP in keys, RUN in keys, over, MARK in keys)
