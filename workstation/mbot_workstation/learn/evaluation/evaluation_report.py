"""Scores of several contestants side by side: a table for people, JSON for scripts, a picture."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from rich.table import Table

from mbot_workstation.learn.evaluation.episodes import Estimate, Score, Trial
from mbot_workstation.pictures.picture_file import save_figure
from mbot_workstation.tasks.find import find_task
from mbot_workstation.tasks.task import Task

COLOURS = ("#3b6ea5", "#d9772b", "#5a9a5a", "#8a6bb1", "#777777", "#b05a6a")


@dataclass(frozen=True, slots=True)
class Line:
    """One contestant under one preset."""

    contestant: str
    preset: str
    score: Score


def fields(line: Line, lines: Sequence[Line], task: Task) -> dict[str, object]:
    """A line as a JSON object, in the task's words."""
    own = {
        "count": task.counted,
        "decisions_per_count": f"decisions_per_{task.counted_one}",
    }
    share = share_of_oracle(line, lines)
    score = asdict(line.score)
    mistakes = score.pop("mistakes")
    return {
        "contestant": line.contestant,
        "preset": line.preset,
        **{own.get(name, name): value for name, value in score.items()},
        **mistakes,
        "share_of_oracle": None if share is None else round(share, 4),
    }


def share_of_oracle(line: Line, lines: Sequence[Line]) -> float | None:
    """The mean reward by the oracle's under the same preset, if it took part."""
    for other in lines:
        if other.contestant == "oracle" and other.preset == line.preset:
            best = other.score.reward.mean
            return line.score.reward.mean / best if best else None
    return None


def table(lines: Sequence[Line], title: str, task: Task) -> Table:
    """All lines, within 80 columns; intervals of the others are in `fields`."""
    has_oracle = any(share_of_oracle(line, lines) is not None for line in lines)
    mistakes = [
        name
        for name in task.mistakes
        if any(line.score.mistakes[name].mean > 0 for line in lines if line.score.mistakes)
    ]
    grid = Table(title=title, title_justify="left", box=None, padding=(0, 2, 0, 0))
    grid.add_column("preset", no_wrap=True)
    grid.add_column("contestant", overflow="fold")
    for name in ("reward, 95 %", *headings(task, "\n")):
        grid.add_column(name, justify="right", no_wrap=True)
    for name in mistakes:
        grid.add_column(name.replace("_", "\n"), justify="right", no_wrap=True)
    if has_oracle:
        grid.add_column("of the\noracle", justify="right", no_wrap=True)
    for line in lines:
        one, share = line.score, share_of_oracle(line, lines)
        decisions = one.decisions_per_count
        cells = (
            line.preset,
            line.contestant,
            _words(one.reward),
            f"{one.count.mean:.2f}",
            f"{100 * one.success.mean:.0f} %",
            "none" if decisions is None else f"{decisions.mean:.1f}",
            *(f"{one.mistakes[name].mean:.2f}" for name in mistakes),
        )
        oracle = ("" if share is None else f"{100 * share:.1f} %",) if has_oracle else ()
        grid.add_row(*cells, *oracle)
    return grid


def headings(task: Task, gap: str = " ") -> tuple[str, str, str]:
    """Of columns: what is counted, the share of complete episodes, what one of them takes."""
    article = "an" if task.counted_one[0] in "aeiou" else "a"
    return (
        task.counted,
        f"all{gap}{task.counted_done}",
        f"decisions{gap}{article} {task.counted_one}",
    )


def _words(estimate: Estimate) -> str:
    mean, low, high = (f"{value:.2f}" for value in (estimate.mean, estimate.low, estimate.high))
    return f"{mean} ({low}-{high})" if estimate.low >= 0 else f"{mean} ({low} to {high})"


def draw(lines: Sequence[Line], path: Path, trial: Trial) -> None:
    """Bars of reward and of decisions for each that is counted, by preset.

    Args:
        lines: at least one.
        path: a file matplotlib can write, such as a PNG.
        trial: how they were tried; published figures of its lesson are drawn in.

    Raises:
        ConfigurationError: it can't be written.

    """
    task = find_task(trial.task)
    reference = task.reference(trial.lesson)
    presets = list(dict.fromkeys(line.preset for line in lines))
    contestants = list(dict.fromkeys(line.contestant for line in lines))
    figure = Figure(figsize=(max(6.0, 2.5 + 1.3 * len(presets)), 6), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    _bars(upper, lines, presets, contestants, lambda score: score.reward)
    _bars(lower, lines, presets, contestants, lambda score: score.decisions_per_count)
    upper.set_ylabel("mean reward")
    lower.set_ylabel(headings(task)[2])
    lower.set_xticks(range(len(presets)), presets)
    for axes in (upper, lower):
        axes.spines[["top", "right"]].set_visible(False)
    if reference is not None:
        for axes, paper in ((upper, reference.reward), (lower, reference.decisions)):
            axes.axhline(paper, color="#666666", linestyle="--", linewidth=1, label="paper")
    figure.legend(*upper.get_legend_handles_labels(), loc="outside upper center", ncols=6)
    save_figure(figure, path)


def _bars(
    axes: Any, lines: Sequence[Line], presets: list[str], contestants: list[str], pick: Any
) -> None:
    width = 0.8 / len(contestants)
    for number, contestant in enumerate(contestants):
        shown = [
            (presets.index(line.preset), pick(line.score))
            for line in lines
            if line.contestant == contestant and pick(line.score) is not None
        ]
        means = [estimate.mean for _, estimate in shown]
        below = [max(0.0, estimate.mean - estimate.low) for _, estimate in shown]
        above = [max(0.0, estimate.high - estimate.mean) for _, estimate in shown]
        axes.bar(
            [place - 0.4 + width * (number + 0.5) for place, _ in shown],
            means,
            width * 0.92,
            yerr=[below, above],
            capsize=2,
            label=contestant,
            color=COLOURS[number % len(COLOURS)],
            error_kw={"linewidth": 1},
        )
