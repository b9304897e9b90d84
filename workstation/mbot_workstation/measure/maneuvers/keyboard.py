"""Single keys from a terminal, without waiting for Enter."""

import os
import select
import sys
import termios
import tty
from typing import Any, Protocol, Self


class Keys(Protocol):
    """Where keys come from."""

    def pressed(self) -> str | None:
        """The oldest key nobody has taken, in lower case ("enter" for Enter), or None."""
        ...


class NoKeys:
    """Nobody sits there."""

    def pressed(self) -> str | None:
        """Never a key."""
        return None


class Keyboard:
    """The terminal on standard input, a context manager; Ctrl-C works as ever."""

    def __init__(self, descriptor: int | None = None) -> None:
        self._descriptor = sys.stdin.fileno() if descriptor is None else descriptor
        self._before: list[Any] = []

    def __enter__(self) -> Self:
        self._before = termios.tcgetattr(self._descriptor)
        tty.setcbreak(self._descriptor)
        return self

    def __exit__(self, *_: object) -> None:
        termios.tcsetattr(self._descriptor, termios.TCSADRAIN, self._before)

    def pressed(self) -> str | None:
        """The oldest key nobody has taken, in lower case ("enter" for Enter), or None."""
        readable, _, _ = select.select([self._descriptor], [], [], 0)
        if not readable:
            return None
        data = os.read(self._descriptor, 1)
        if data in (b"\n", b"\r"):
            return "enter"
        return data.decode("latin-1").lower() or None
