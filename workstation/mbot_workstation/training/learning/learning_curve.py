"""The paper's Fig. 4 of a run: reward, episode length and lesson over the decisions."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.pictures.picture_file import save_figure
from mbot_workstation.training.learning.progress_log import ProgressRow
from mbot_workstation.training.worlds.lessons import LESSONS

PAPER_REWARD, PAPER_LENGTH = 19.8, 200.0
"""The paper's plateau in its last lesson."""


_COLOUR, _PAPER = "#3b6ea5", "#999999"


def draw_curve(rows: Sequence[ProgressRow], path: Path, title: str = "") -> None:
    """Write the picture.

    Args:
        rows: of progress.csv, at least one.
        path: a file matplotlib can write, such as a PNG.
        title: above it.

    Raises:
        ConfigurationError: there are no rows yet, or the file can't be written.

    """
    if not rows:
        raise ConfigurationError("the run has no row in progress.csv yet; train it longer")
    figure = Figure(figsize=(8, 6.5), layout="constrained")
    axes: Any = figure.subplots(3, 1, sharex=True, gridspec_kw={"height_ratios": [3, 3, 1.6]})
    steps = [row.step / 1e6 for row in rows]
    _panel(
        axes[0], steps, [row.mean_reward for row in rows], "mean reward of an episode", PAPER_REWARD
    )
    _panel(axes[1], steps, [row.mean_length for row in rows], "episode, decisions", PAPER_LENGTH)
    names = list(dict.fromkeys(row.lesson for row in rows))
    axes[2].step(steps, [names.index(row.lesson) for row in rows], where="post", color=_COLOUR)
    axes[2].set_yticks(range(len(names)), names, fontsize=8 if len(names) > 5 else 10)
    axes[2].set_ylabel("lesson")
    axes[2].set_xlabel(
        f"decisions (millions); {rows[-1].step:,} in {rows[-1].wall_s / 60:.0f} minutes"
    )
    for panel in axes:
        panel.grid(alpha=0.3)
        panel.spines[["top", "right"]].set_visible(False)
    axes[0].set_ylim(bottom=min(0.0, *(row.mean_reward for row in rows)) - 0.5)
    axes[1].set_ylim(bottom=0)
    axes[2].set_xlim(left=0)
    if note := mark_note(names[-1]):
        axes[0].set_title(note, fontsize=9)
    if title:
        figure.suptitle(title)
    save_figure(figure, path)


def mark_note(lesson: str) -> str:
    """What to know of the paper's plateau beside a run that ends in this lesson; mostly nothing."""
    if lesson in {one.name for one in LESSONS}:
        return ""
    return f"the last lesson, {lesson}, is harder than the paper's, whose plateau is no mark for it"


def _panel(axes: Any, steps: list[float], values: list[float], label: str, paper: float) -> None:
    axes.plot(steps, values, color=_COLOUR, marker="o", markersize=3)
    axes.axhline(paper, color=_PAPER, linestyle="--", linewidth=1)
    axes.annotate(
        f"paper's plateau {paper:g}",
        (1, paper),
        xycoords=("axes fraction", "data"),
        ha="right",
        va="bottom",
        fontsize=8,
        color="#666666",
    )
    axes.set_ylabel(label)
