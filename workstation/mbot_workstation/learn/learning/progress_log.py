"""How a training run goes: means of the finished episodes, a row every 40,000 decisions."""

import csv
import math
from collections import deque
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, fields
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
        terms: of the task's reward, what an episode brought by each; columns bear their names.

    """

    step: int
    wall_s: float
    lesson: str
    mean_reward: float
    mean_length: float
    mean_count: float
    episodes: int
    terms: Mapping[str, float] = field(default_factory=dict[str, float])

    def cells(self, terms: Sequence[str]) -> list[object]:
        """As they are written; a term that was not paid then is no number."""
        paid = [self.terms.get(term, math.nan) for term in terms]
        return [getattr(self, name) for name in _NAMES] + paid


_NAMES = tuple(one.name for one in fields(ProgressRow) if one.name != "terms")
_MEAN = "mean_"


def columns(counted: str, terms: Sequence[str] = ()) -> list[str]:
    """The file's first line for a task that counts this and pays by these terms."""
    own = [name.replace("count", counted) for name in _NAMES]
    return own + [f"{_MEAN}{term}" for term in terms]


@dataclass(frozen=True, slots=True)
class FinishedEpisode:
    """A finished episode: its reward, length in decisions, what the task counts, and what each term
    of its reward brought.
    """

    reward: float
    length: int
    count: int
    terms: Mapping[str, float] = field(default_factory=dict[str, float])


class ProgressLog:
    """Collects episodes and writes the rows; every row is on disk at once."""

    def __init__(
        self,
        path: Path,
        counted: str,
        step: int = 0,
        row_every: int = ROW_EVERY,
        terms: Sequence[str] = (),
    ) -> None:
        """Begin the file, or go on after a step: later rows belong to a lost future."""
        self._path, self._terms = path, terms
        self._row_every = row_every
        self._next_step = (step // row_every + 1) * row_every
        self._since_row: list[FinishedEpisode] = []
        self.recent: deque[FinishedEpisode] = deque(maxlen=WINDOW_EPISODES)
        kept = [row for row in read_progress(path) if row.step <= step] if path.is_file() else []
        with path.open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(columns(counted, terms))
            writer.writerows(row.cells(terms) for row in kept)

    def add(self, episode: FinishedEpisode) -> None:
        """Count a finished episode."""
        self._since_row.append(episode)
        self.recent.append(episode)

    def row_if_due(self, step: int, wall_s: float, lesson: str) -> ProgressRow | None:
        """Write a row if the interval is over and an episode has ended in it."""
        if step < self._next_step or not self._since_row:
            return None
        self._next_step = (step // self._row_every + 1) * self._row_every
        ended = self._since_row
        terms = {
            name: round(fmean(episode.terms[name] for episode in ended), 4) for name in self._terms
        }
        row = ProgressRow(step, round(wall_s, 1), lesson, *_means(ended), len(ended), terms)
        ended.clear()
        with self._path.open("a", newline="") as file:
            csv.writer(file).writerow(row.cells(self._terms))
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
        counted = names[len(_NAMES) - 2]  # whatever the task counts, before the episodes
        terms = [name.removeprefix(_MEAN) for name in names[len(_NAMES) :]]
        return [
            ProgressRow(
                step=int(row["step"]),
                wall_s=float(row["wall_s"]),
                lesson=row["lesson"],
                mean_reward=float(row["mean_reward"]),
                mean_length=float(row["mean_length"]),
                mean_count=float(row[counted]),
                episodes=int(row["episodes"]),
                terms={term: float(row[_MEAN + term]) for term in terms},
            )
            for row in table
        ]
    except (IndexError, KeyError, TypeError, ValueError):
        raise ConfigurationError(
            f"{path} is not the progress of a training; expected the columns "
            f"{', '.join(columns('COUNT'))}"
        ) from None


def _means(episodes: Collection[FinishedEpisode]) -> tuple[float, float, float]:
    return (
        round(fmean(episode.reward for episode in episodes), 4),
        round(fmean(episode.length for episode in episodes), 2),
        round(fmean(episode.count for episode in episodes), 3),
    )
