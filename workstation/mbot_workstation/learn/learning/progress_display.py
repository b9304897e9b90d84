"""What a person sees of a training run: a bar on a terminal, lines in a log."""

import sys
import time
from collections.abc import Iterable
from dataclasses import dataclass, replace
from types import TracebackType
from typing import Protocol, Self

from rich.console import Console, RenderableType
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn

from mbot_workstation.learn.learning.progress_log import ProgressRow

LONGEST_GUESS_S = 60.0
"""So long a bar moves on by itself; an update of the largest networks takes less."""


@dataclass(frozen=True, slots=True)
class RunMoment:
    """A run at one moment.

    Attributes:
        step, steps: decisions so far and planned.
        lesson: by name.
        means: reward, length and count of the latest episodes; None before the first.
        steps_per_s: lately.

    """

    step: int
    steps: int
    lesson: str
    means: tuple[float, float, float] | None
    steps_per_s: float

    @property
    def left_s(self) -> float:
        """Time to the end at this speed; 0 beyond it: runs make whole rollouts."""
        left = max(0, self.steps - self.step)
        return left / self.steps_per_s if self.steps_per_s > 0 else 0.0

    def after(self, elapsed_s: float) -> "RunMoment":
        """Where the run probably is so much later, if nobody says: never beyond its end."""
        made = round(self.steps_per_s * min(elapsed_s, LONGEST_GUESS_S))
        return replace(self, step=max(self.step, min(self.step + made, self.steps)))


class RunDisplay(Protocol):
    """Shows a run; used in a `with`."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...

    def show(self, moment: RunMoment) -> None:
        """Called a few times a second at most."""
        ...

    def row(self, row: ProgressRow, counted: str) -> None:
        """Called for every row of progress.csv, with what its task counts."""
        ...

    def say(self, text: str) -> None:
        """Called for what else a person should know, a line each."""
        ...


class LineDisplay:
    """A line on stderr for every row; nothing in between."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        return None

    def show(self, moment: RunMoment) -> None:
        """Nothing."""

    def row(self, row: ProgressRow, counted: str) -> None:
        """Print the row."""
        print(
            f"{row.step:>9,} decisions  {clock(row.wall_s)}  lesson {row.lesson:<4}  "
            f"reward {row.mean_reward:6.2f}  length {row.mean_length:6.1f}  "
            f"{counted} {row.mean_count:5.2f}",
            file=sys.stderr,
            flush=True,
        )

    def say(self, text: str) -> None:
        """Print it."""
        print(text, file=sys.stderr, flush=True)


class _Gliding(Progress):
    """A bar that moves on between two moments, while the learner learns and says nothing."""

    def __init__(self, *columns: TextColumn | BarColumn, console: Console) -> None:
        self._moment: RunMoment | None = None
        self._told_s = 0.0
        super().__init__(*columns, console=console)  # which draws already
        self.add_task("", total=None, lesson="1", figures="")

    def tell(self, moment: RunMoment) -> None:
        """Where the run is; the bar never goes back."""
        self._moment, self._told_s = moment, time.monotonic()

    def get_renderables(self) -> Iterable[RenderableType]:
        """Called by rich ten times a second."""
        if self._moment is not None:
            now = self._moment.after(time.monotonic() - self._told_s)
            step = max(now.step, round(self.tasks[0].completed))
            words = figures(replace(now, step=step))
            self.tasks[0].fields.update(lesson=now.lesson, figures=words)
            self.tasks[0].completed, self.tasks[0].total = step, now.steps
        yield from super().get_renderables()


class BarDisplay(LineDisplay):
    """A bar that stays in its line, rows above it."""

    def __init__(self, console: Console) -> None:
        self.progress = _Gliding(
            TextColumn("lesson {task.fields[lesson]}"),
            BarColumn(),
            TaskProgressColumn(),
            TextColumn("{task.fields[figures]}"),
            console=console,
        )

    def __enter__(self) -> Self:
        self.progress.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.progress.stop()

    def show(self, moment: RunMoment) -> None:
        """Move the bar."""
        self.progress.tell(moment)


def figures(moment: RunMoment) -> str:
    """Reward, length, speed and time left in one short text."""
    speed = f"{moment.steps_per_s:,.0f} steps/s, {clock(moment.left_s)} left"
    if moment.means is None:
        return speed
    reward, length, _ = moment.means
    return f"reward {reward:.2f}, length {length:.0f}, {speed}"


def clock(seconds: float) -> str:
    """Hours, minutes and seconds: "0:07:30"."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}"


def display() -> RunDisplay:
    """What suits stderr."""
    console = Console(stderr=True)
    return BarDisplay(console) if console.is_terminal else LineDisplay()
