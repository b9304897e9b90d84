"""A session on a terminal: its display, and single keys."""

import os
import select
import sys
import termios
import tty
from typing import Any, Self, TextIO

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from mbot_workstation.measure.maneuvers.plan import Planned


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


class PlainDisplay:
    """Who is told what goes on: here a line a run."""

    def __init__(self, stream: TextIO = sys.stdout) -> None:
        self._stream = stream
        self._place = ""

    def next_run(self, run: Planned, done: int, total: int) -> None:
        """Remember which it is."""
        self._place = f"{done + 1} of {total}"

    def countdown(self, left_s: float) -> None:
        """Nothing: nobody watches."""

    def driving(self) -> None:
        """Nothing: the run is named when it is kept."""

    def recorded(self, run: Planned, number: int) -> None:
        """One line."""
        self.say(
            f"{self._place}: {run.maneuver.name}, repetition {run.repetition}, kept as run {number}"
        )

    def say(self, text: str) -> None:
        """The text as it is."""
        print(text, file=self._stream, flush=True)


class TerminalDisplay(PlainDisplay):
    """A bar with what comes next; a context manager."""

    def __init__(self, console: Console) -> None:
        super().__init__()
        self._console = console
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(24),
            TextColumn("{task.completed:.0f} of {task.total:.0f} runs"),
            TimeRemainingColumn(),
            console=console,
            transient=True,
        )
        self._task = self._progress.add_task("starting", total=1)
        self._name = ""

    def __enter__(self) -> "TerminalDisplay":
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()

    def next_run(self, run: Planned, done: int, total: int) -> None:
        """Name it."""
        self._name = f"{run.maneuver.name}, repetition {run.repetition}"
        self._progress.update(self._task, completed=done, total=total, description=self._name)

    def countdown(self, left_s: float) -> None:
        """Show the seconds, and what keys do."""
        text = f"[bold]{self._name}[/] in {left_s:.0f} s  [dim]p pauses, r repeats, q quits[/]"
        self._progress.update(self._task, description=text)

    def driving(self) -> None:
        """Warn that it moves."""
        text = f"[bold red]drives[/] [bold]{self._name}[/]  [dim]any key stops[/]"
        self._progress.update(self._task, description=text)

    def recorded(self, run: Planned, number: int) -> None:
        """Advance the bar."""
        self._progress.advance(self._task)
        self.say(f"run {number}: {run.maneuver.name}, repetition {run.repetition}")

    def say(self, text: str) -> None:
        """The text above the bar."""
        self._console.print(text, highlight=False)
