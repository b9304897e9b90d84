"""What a person sees of a training run: a bar on a terminal, lines in a log."""

import sys
from dataclasses import dataclass
from types import TracebackType
from typing import Protocol, Self

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn

from mbot_workstation.learn.learning.progress_log import ProgressRow


@dataclass(frozen=True, slots=True)
class Moment:
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
        """Time to the end at this speed."""
        return (self.steps - self.step) / self.steps_per_s if self.steps_per_s > 0 else 0.0


class Display(Protocol):
    """Shows a run; used in a `with`."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...

    def show(self, moment: Moment) -> None:
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

    def show(self, moment: Moment) -> None:
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


class BarDisplay(LineDisplay):
    """A bar that stays in its line, rows above it."""

    def __init__(self, console: Console) -> None:
        self._progress = Progress(
            TextColumn("lesson {task.fields[lesson]}"),
            BarColumn(),
            TaskProgressColumn(),
            TextColumn("{task.fields[figures]}"),
            console=console,
        )
        self._task = self._progress.add_task("", total=None, lesson="1", figures="")

    def __enter__(self) -> Self:
        self._progress.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._progress.stop()

    def show(self, moment: Moment) -> None:
        """Move the bar."""
        self._progress.update(
            self._task,
            completed=moment.step,
            total=moment.steps,
            lesson=moment.lesson,
            figures=figures(moment),
        )


def figures(moment: Moment) -> str:
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


def display() -> Display:
    """What suits stderr."""
    console = Console(stderr=True)
    return BarDisplay(console) if console.is_terminal else LineDisplay()
