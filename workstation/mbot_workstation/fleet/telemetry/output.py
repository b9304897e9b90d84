"""Where telemetry goes: a live view, plain lines, or JSON lines."""

import json
import sys
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from types import TracebackType
from typing import Protocol, Self, TextIO

from rich.console import Console
from rich.live import Live

from mbot_protocol.beat.fields import decision_fields
from mbot_protocol.v1.messages_pb2 import Decision
from mbot_workstation.fleet.telemetry.stream import LinkState, Sample
from mbot_workstation.fleet.telemetry.view import link_words, plain_line, render
from mbot_workstation.fleet.telemetry.window import TelemetryWindow

LINE_EVERY_S = 2.0
DRAW_EVERY_S = 0.2


class Output(AbstractContextManager["Output"], Protocol):
    """Takes samples; `refresh` is called many times a second, samples or not."""

    def take(self, sample: Sample) -> None:
        """One more sample."""
        ...

    def refresh(self, link: LinkState, silence_s: float) -> None:
        """Show what is due."""
        ...


class _Plain:
    """Common to outputs that need no opening or closing."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass


class JsonLines(_Plain):
    """One JSON object a decision on stdout; what is wrong with the link goes to stderr."""

    def __init__(self, out: TextIO, errors: TextIO) -> None:
        self._out = out
        self._errors = errors
        self._link = LinkState.LIVE

    def take(self, sample: Sample) -> None:
        """Write a decision; pictures are left to `--record`."""
        if isinstance(sample.message, Decision):
            print(json.dumps(decision_fields(sample.message)), file=self._out, flush=True)

    def refresh(self, link: LinkState, silence_s: float) -> None:
        """Tell a change of the link, once."""
        if link is not self._link:
            self._link = link
            words = link_words(link, silence_s) or "telemetry is back"
            print(f"workstation: {words}", file=self._errors, flush=True)


class PlainLines(_Plain):
    """A line every now and then, for logs and pipes."""

    def __init__(
        self,
        robot_id: str,
        out: TextIO,
        monotonic_s: Callable[[], float] = time.monotonic,
        every_s: float = LINE_EVERY_S,
    ) -> None:
        self._robot_id = robot_id
        self._out = out
        self._monotonic_s = monotonic_s
        self._window = TelemetryWindow()
        self._every_s = every_s
        self._due_s = monotonic_s() + every_s

    def take(self, sample: Sample) -> None:
        """Count it in."""
        self._window.add(sample)

    def refresh(self, link: LinkState, silence_s: float) -> None:
        """Print a line if one is due."""
        now_s = self._monotonic_s()
        if now_s >= self._due_s:
            self._due_s = now_s + self._every_s
            line = plain_line(self._robot_id, self._window, link, silence_s)
            print(line, file=self._out, flush=True)


class LiveView:
    """The view that redraws itself in a terminal, and stays on screen at the end."""

    def __init__(self, robot_id: str, console: Console) -> None:
        self._robot_id = robot_id
        self._window = TelemetryWindow()
        self._live = Live(console=console, auto_refresh=False)
        self._due_s = 0.0

    def __enter__(self) -> Self:
        self._live.__enter__()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._live.__exit__(kind, error, trace)

    def take(self, sample: Sample) -> None:
        """Count it in."""
        self._window.add(sample)

    def refresh(self, link: LinkState, silence_s: float) -> None:
        """Redraw, at most five times a second."""
        now_s = time.monotonic()
        if now_s >= self._due_s:
            self._due_s = now_s + DRAW_EVERY_S
            view = render(self._robot_id, self._window, link, silence_s)
            self._live.update(view, refresh=True)


def output_for(robot_id: str, *, as_json: bool, line_every_s: float = LINE_EVERY_S) -> Output:
    """What fits standard output: JSON lines if they are asked for, a live view in a terminal, or a
    line every so often.
    """
    if as_json:
        return JsonLines(sys.stdout, sys.stderr)
    console = Console()
    if console.is_terminal:
        return LiveView(robot_id, console)
    return PlainLines(robot_id, sys.stdout, every_s=line_every_s)
