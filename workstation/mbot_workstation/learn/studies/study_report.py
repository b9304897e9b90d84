"""A study's results as a Markdown page and a picture."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.files import atomic_file
from mbot_workstation.learn.evaluation.episodes import Estimate, Trial
from mbot_workstation.learn.evaluation.evaluation_report import (
    COLOURS,
    Line,
    draw,
    headings,
    share_of_oracle,
)
from mbot_workstation.learn.studies.study_run import Study
from mbot_workstation.pictures.picture_file import save_figure
from mbot_workstation.tasks.find import find_task
from mbot_workstation.tasks.task import Task


def write_report(study: Study, lines: Sequence[Line], folder: Path, how: str, trial: Trial) -> Path:
    """Write `<name>.md` and `<name>.png`.

    Args:
        study: what was studied.
        lines: what came out.
        folder: where to; made if need be.
        how: one line on how it was tried.
        trial: as it was tried.

    Returns:
        The page.

    Raises:
        ConfigurationError: the folder can't be written.

    """
    picture, task = folder / f"{study.name}.png", find_task(trial.task)
    make_folder(folder)
    if study.axis:
        _draw_curves(study, lines, picture, task)
    else:
        draw(lines, picture, trial)
    page = folder / f"{study.name}.md"
    text = (
        f"# {study.heading}\n\n{study.question}\n\n{how}\n\n{markdown(lines, task)}\n\n"
        f"![{study.heading}]({picture.name})\n"
    )
    atomic_file.save(page, text.encode())
    return page


def make_folder(folder: Path) -> None:
    """Make a folder for results.

    Raises:
        ConfigurationError: it can't be made.

    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigurationError(f"can't make {folder}: {error.strerror}") from None


def markdown(lines: Sequence[Line], task: Task) -> str:
    """The lines as a Markdown table; intervals are of 95 %."""
    rows = [
        f"| condition | policy | mean reward | {' | '.join(headings(task))} "
        "| share of the oracle |",
        "|---|---|---|---|---|---|---|",
    ]
    for line in lines:
        one, share = line.score, share_of_oracle(line, lines)
        per_count = one.decisions_per_count
        rows.append(
            f"| {line.preset} | {line.contestant} | {_words(one.reward)} | "
            f"{one.count.mean:.2f} | {100 * one.success.mean:.0f} % | "
            f"{'none' if per_count is None else _words(per_count)} | "
            f"{'' if share is None else f'{100 * share:.1f} %'} |"
        )
    return "\n".join(rows)


def _words(estimate: Estimate) -> str:
    return f"{estimate.mean:.2f} ({estimate.low:.2f} to {estimate.high:.2f})"


def _draw_curves(study: Study, lines: Sequence[Line], path: Path, task: Task) -> None:
    values = {condition.label: condition.value for condition in study.conditions}
    figure = Figure(figsize=(7, 6), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    panels: list[tuple[Any, str, Any]] = [
        (upper, "mean reward", lambda score: score.reward),
        (lower, headings(task)[2], lambda score: score.decisions_per_count),
    ]
    for axes, label, pick in panels:
        for number, contestant in enumerate(dict.fromkeys(line.contestant for line in lines)):
            shown = [
                (values[line.preset], pick(line.score))
                for line in lines
                if line.contestant == contestant and pick(line.score) is not None
            ]
            places = [place for place, _ in shown]
            colour = COLOURS[number % len(COLOURS)]
            means = [estimate.mean for _, estimate in shown]
            axes.plot(places, means, marker="o", markersize=4, color=colour, label=contestant)
            axes.fill_between(
                places,
                [estimate.low for _, estimate in shown],
                [estimate.high for _, estimate in shown],
                color=colour,
                alpha=0.15,
                linewidth=0,
            )
        axes.set_ylabel(label)
        axes.grid(alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
    lower.set_xlabel(study.axis)
    lower.set_ylim(bottom=0)
    upper.legend(loc="best")
    save_figure(figure, path)
