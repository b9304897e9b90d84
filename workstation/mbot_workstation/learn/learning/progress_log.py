"""How a training run goes: means of the finished episodes, a row every 40,000 decisions."""

import csv
from collections import deque
from collections.abc import Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from statistics import fmean

from mbot_protocol.errors import ConfigurationError

ROW_EVERY = 40_000
"""Decisions; the paper's interval, so that the curves compare."""

WINDOW_EPISODES = 100
"""What the display averages over between rows."""


@dataclass(frozen=True, slots=True)
class ProgressRow:
    """One row of progress.csv.

    Attributes:
        step: decisions so far.
        wall_s: training time so far.
        lesson: at the row's end.
        mean_reward, mean_length: of the episodes that ended since the last row; length in
            decisions.
        mean_count: of what the task counts; the column bears its name, such as mean_touches.
        episodes: how many those were.

    """

    step: int
    wall_s: float
    lesson: str
    mean_reward: float
    mean_length: float
    mean_count: float
    episodes: int


def columns(counted: str) -> list[str]:
    """The file's first line for a task that counts this."""
    return [field.name.replace("count", counted) for field in fields(ProgressRow)]


@dataclass(frozen=True, slots=True)
class Episode:
    """A finished episode: its reward, length in decisions, and what the task counts."""

    reward: float
    length: int
    count: int


class ProgressLog:
    """Collects episodes and writes the rows; every row is on disk at once."""

    def __init__(self, path: Path, counted: str, step: int = 0, row_every: int = ROW_EVERY) -> None:
        """Begin the file, or go on after a step: later rows belong to a lost future."""
        self._path = path
        self._row_every = row_every
        self._next_step = (step // row_every + 1) * row_every
        self._since_row: list[Episode] = []
        self.recent: deque[Episode] = deque(maxlen=WINDOW_EPISODES)
        kept = [row for row in read_progress(path) if row.step <= step] if path.is_file() else []
        with path.open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(columns(counted))
            writer.writerows(astuple(row) for row in kept)

    def add(self, episode: Episode) -> None:
        """Count a finished episode."""
        self._since_row.append(episode)
        self.recent.append(episode)

    def row_if_due(self, step: int, wall_s: float, lesson: str) -> ProgressRow | None:
        """Write a row if the interval is over and an episode has ended in it."""
        if step < self._next_step or not self._since_row:
            return None
        self._next_step = (step // self._row_every + 1) * self._row_every
        row = ProgressRow(
            step, round(wall_s, 1), lesson, *_means(self._since_row), len(self._since_row)
        )
        self._since_row.clear()
        with self._path.open("a", newline="") as file:
            csv.writer(file).writerow(astuple(row))
        return row

    def recent_means(self) -> tuple[float, float, float] | None:
        """Mean reward, length and count of the latest episodes."""
        return _means(self.recent) if self.recent else None


def read_progress(path: Path) -> list[ProgressRow]:
    """The rows of a progress.csv.

    Raises:
        ConfigurationError: there is no such file, or it is something else.

    """
    try:
        with path.open(newline="") as file:
            reader = csv.DictReader(file)
            names, table = list(reader.fieldnames or ()), list(reader)
    except OSError as error:
        raise ConfigurationError(f"can't read {path}: {error.strerror}") from None
    try:
        counted = names[len(columns("")) - 2]  # whatever the task counts, before the episodes
        return [
            ProgressRow(
                step=int(row["step"]),
                wall_s=float(row["wall_s"]),
                lesson=row["lesson"],
                mean_reward=float(row["mean_reward"]),
                mean_length=float(row["mean_length"]),
                mean_count=float(row[counted]),
                episodes=int(row["episodes"]),
            )
            for row in table
        ]
    except (IndexError, KeyError, TypeError, ValueError):
        raise ConfigurationError(
            f"{path} is not the progress of a training; expected the columns "
            f"{', '.join(columns('COUNT'))}"
        ) from None


def _means(episodes: Sequence[Episode] | deque[Episode]) -> tuple[float, float, float]:
    return (
        round(fmean(episode.reward for episode in episodes), 4),
        round(fmean(episode.length for episode in episodes), 2),
        round(fmean(episode.count for episode in episodes), 3),
    )
