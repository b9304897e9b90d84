"""The paper's Fig. 4 of runs: reward, episode length and lesson over the decisions."""

import itertools
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.learn.learning.progress_log import ProgressRow
from mbot_workstation.pictures.picture_file import save_figure
from mbot_workstation.tasks.lesson import lesson_named
from mbot_workstation.tasks.task import Task

_COLOURS, _PAPER = ("#3b6ea5", "#c8553d", "#588157", "#8e6c8a", "#c99a2e"), "#999999"


def draw_curves(runs: Mapping[str, Sequence[ProgressRow]], task: Task, path: Path) -> None:
    """Write the picture.

    Args:
        runs: by name, rows of progress.csv, at least one each.
        task: what they learned.
        path: a file matplotlib can write, such as a PNG.

    Raises:
        ConfigurationError: there are no rows yet, or the file can't be written.

    """
    for name, rows in runs.items():
        if not rows:
            raise ConfigurationError(f"{name} has no row in progress.csv yet; train it longer")
    by_term = len(runs) == 1 and bool(next(iter(runs.values()))[-1].terms)
    heights = [3, 3, 1.6, 3] if by_term else [3, 3, 1.6]
    figure = Figure(figsize=(8, 6.5 + 2.2 * by_term), layout="constrained")
    axes: Any = figure.subplots(
        len(heights), 1, sharex=True, gridspec_kw={"height_ratios": heights}
    )
    lessons = list(dict.fromkeys(row.lesson for rows in runs.values() for row in rows))
    titles = [f"{name}: {rows[-1].wall_s / 60:.0f} minutes" for name, rows in runs.items()]
    for title, rows, colour in zip(titles, runs.values(), itertools.cycle(_COLOURS), strict=False):
        steps = [row.step / 1e6 for row in rows]
        look: dict[str, Any] = {"color": colour, "marker": "o", "markersize": 3, "label": title}
        axes[0].plot(steps, [row.mean_reward for row in rows], **look)
        axes[1].plot(steps, [row.mean_length for row in rows], **look)
        at = [lessons.index(row.lesson) for row in rows]
        axes[2].step(steps, at, where="post", color=colour)
    axes[0].set_ylabel("mean reward of an episode")
    axes[1].set_ylabel("episode, decisions")
    last = lesson_named(task.lessons, task.course(guided=False, further=False)[-1])
    if (reference := task.reference(last)) is not None:
        _mark(axes[0], reference.reward)
        _mark(axes[1], reference.decisions * last.goal)
    axes[2].set_yticks(range(len(lessons)), lessons, fontsize=8 if len(lessons) > 5 else 10)
    axes[2].set_ylabel("lesson")
    if by_term:
        _draw_terms(axes[3], next(iter(runs.values())))
    axes[-1].set_xlabel("decisions (millions)")
    for panel in axes:
        panel.grid(alpha=0.3)
        panel.spines[["top", "right"]].set_visible(False)
    lowest = min(row.mean_reward for rows in runs.values() for row in rows)
    axes[0].set_ylim(bottom=min(0.0, lowest) - 0.5)
    axes[1].set_ylim(bottom=0)
    axes[2].set_xlim(left=0)
    if note := mark_note(task, next(iter(runs.values()))[-1].lesson):
        axes[0].set_title(note, fontsize=9)
    if len(runs) > 1:
        axes[0].legend(loc="lower right", bbox_to_anchor=(1, 0.1), fontsize=8)
    else:
        figure.suptitle(titles[0])
    save_figure(figure, path)


def mark_note(task: Task, lesson: str) -> str:
    """What to know of a published plateau beside a run that ends in this lesson; mostly nothing."""
    if not lesson_named(task.lessons, lesson).needs_training:
        return ""
    return (
        f"the last lesson, {lesson}, is harder than the paper's, whose plateau does not apply to it"
    )


def _draw_terms(axes: Any, rows: Sequence[ProgressRow]) -> None:
    """What an episode was paid by each term of the reward."""
    steps = [row.step / 1e6 for row in rows]
    for name, colour in zip(rows[-1].terms, itertools.cycle(_COLOURS), strict=False):
        paid = [row.terms.get(name, math.nan) for row in rows]
        axes.plot(steps, paid, color=colour, marker="o", markersize=3, label=name)
    axes.set_ylabel("reward by term")
    axes.legend(fontsize=8)


def _mark(axes: Any, plateau: float) -> None:
    axes.axhline(plateau, color=_PAPER, linestyle="--", linewidth=1)
    axes.annotate(
        f"paper's plateau {plateau:g}",
        (1, plateau),
        xycoords=("axes fraction", "data"),
        ha="right",
        va="bottom",
        fontsize=8,
        color="#666666",
    )
