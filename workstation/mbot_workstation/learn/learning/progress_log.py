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
        mean_reward, mean_length, mean_touches: of the episodes that ended since the last row;
            length in decisions.
        episodes: how many those were.

    """

    step: int
    wall_s: float
    lesson: str
    mean_reward: float
    mean_length: float
    mean_touches: float
    episodes: int


COLUMNS = tuple(field.name for field in fields(ProgressRow))


@dataclass(frozen=True, slots=True)
class Episode:
    """A finished episode: its reward, length in decisions, touches."""

    reward: float
    length: int
    touches: int


class ProgressLog:
    """Collects episodes and writes the rows; every row is on disk at once."""

    def __init__(self, path: Path, step: int = 0, row_every: int = ROW_EVERY) -> None:
        """Begin the file, or go on after a step: later rows belong to a lost future."""
        self._path = path
        self._row_every = row_every
        self._next_step = (step // row_every + 1) * row_every
        self._since_row: list[Episode] = []
        self.recent: deque[Episode] = deque(maxlen=WINDOW_EPISODES)
        kept = [row for row in read_progress(path) if row.step <= step] if path.is_file() else []
        with path.open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(COLUMNS)
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
        """Mean reward, length and touches of the latest episodes."""
        return _means(self.recent) if self.recent else None


def read_progress(path: Path) -> list[ProgressRow]:
    """The rows of a progress.csv.

    Raises:
        ConfigurationError: there is no such file, or it is something else.

    """
    try:
        with path.open(newline="") as file:
            table = list(csv.DictReader(file))
    except OSError as error:
        raise ConfigurationError(f"can't read {path}: {error.strerror}") from None
    try:
        return [
            ProgressRow(
                step=int(row["step"]),
                wall_s=float(row["wall_s"]),
                lesson=row["lesson"],
                mean_reward=float(row["mean_reward"]),
                mean_length=float(row["mean_length"]),
                mean_touches=float(row["mean_touches"]),
                episodes=int(row["episodes"]),
            )
            for row in table
        ]
    except (KeyError, TypeError, ValueError):
        raise ConfigurationError(
            f"{path} is not the progress of a training; expected the columns {', '.join(COLUMNS)}"
        ) from None


def _means(episodes: Sequence[Episode] | deque[Episode]) -> tuple[float, float, float]:
    return (
        round(fmean(episode.reward for episode in episodes), 4),
        round(fmean(episode.length for episode in episodes), 2),
        round(fmean(episode.touches for episode in episodes), 3),
    )
