"""`workstation evaluate`: how good is a policy?"""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.commands.calibration_option import CalibrationOption
from mbot_workstation.commands.link_options import JsonOption

if TYPE_CHECKING:
    from mbot_workstation.calibration_files.calibration_folder import CalibrationFiles
    from mbot_workstation.training.evaluation.episodes import EpisodeResult, Trial
    from mbot_workstation.training.worlds.lessons import Lesson
    from mbot_workstation.variation.effects import EffectRanges

TABLE_WIDTH = 140
"""Characters."""


def evaluate(
    *,
    contestants: Annotated[
        list[str],
        typer.Argument(
            metavar="MODEL...",
            help="ONNX policies, or servo (the colour servo), random, oracle (is told where the "
            "object is: an upper bound).",
        ),
    ],
    episodes: Annotated[int, typer.Option(min=1, help="For each of them.")] = 100,
    lesson: Annotated[str, typer.Option(metavar="NAME", help="1 to 10, or blur.")] = "10",
    preset: Annotated[
        list[str] | None,
        typer.Option(
            help="Robots to try it on: ideal, nominal, randomised, or a perturbed one such as "
            "uneven, handicap, sluggish, slippery, blurry, noisy, distorted, dim, bright, late; "
            "all for every one. May be given several times; nominal if not.",
        ),
    ] = None,
    calibration: CalibrationOption = None,
    panorama: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FILE",
            help="360-degree photo of a room to try it in; may be given several times.",
        ),
    ] = None,
    made_up_rooms: Annotated[
        int | None,
        typer.Option(
            min=0,
            metavar="N",
            help="So many generated rooms besides, none of which training uses; 4 without a "
            "photo, 0 with one.",
        ),
    ] = None,
    seed: Annotated[int, typer.Option(help="Of rooms, robots and objects.")] = 0,
    workers: Annotated[
        int | None, typer.Option(min=0, help="Processes; one a core if not given.")
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE.png", help="Draw the comparison too.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Try policies on the paper's task: seeded episodes, means, 95 % confidence intervals.

    The paper's score on lesson 10 is a mean reward of 19.8 in 200 decisions, 20 an object; 21 is
    the most there is.

    Examples:

    - `workstation evaluate policy.onnx servo oracle --plot comparison.png`
    - `workstation evaluate policy.onnx servo --calibration calibration/mbot-1`
    - `workstation evaluate policy.onnx --preset slippery --preset uneven --panorama kitchen.jpg`
    """
    import json

    from rich.console import Console

    from mbot_workstation.calibration_files.calibration_folder import (
        CalibrationFiles,
        read_files,
        room_pictures,
    )
    from mbot_workstation.training.evaluation.episodes import Trial, score
    from mbot_workstation.training.evaluation.evaluation_report import Line, draw, fields, table
    from mbot_workstation.training.worlds.rooms import EVALUATION_ROOMS, gather_rooms

    files = read_files(calibration) if calibration else CalibrationFiles()
    stage = _lesson(lesson)
    robots = _presets(preset or ["nominal"], files if calibration else None)
    panorama = [*(panorama or ()), *(room_pictures(calibration) if calibration else ())]
    made_up = made_up_rooms if made_up_rooms is not None else (0 if panorama else 4)
    if not panorama and not made_up:
        raise ConfigurationError("--made-up-rooms 0 leaves no room; give a --panorama")
    titles = _titles(contestants)
    rooms = gather_rooms(panorama, made_up, EVALUATION_ROOMS)
    lines: list[Line] = []
    for name, effects in robots.items():
        trial = Trial(stage, effects, rooms, episodes, seed, workers, files.robot, files.scene)
        for contestant, title in titles.items():
            results = _with_bar(contestant, f"{title}, {name}", trial)
            lines.append(Line(title, name, score(results)))
    if plot is not None:
        draw(lines, plot, ten_objects=stage.objects == 10)
    if as_json:
        print(json.dumps([fields(line, lines) for line in lines]))
    else:
        heading = f"lesson {lesson}, {episodes} episodes each, {len(rooms)} rooms, seed {seed}"
        console = Console()
        if not console.is_terminal:  # a file has room for all columns
            console = Console(width=TABLE_WIDTH)
        console.print(table(lines, heading))


def _with_bar(contestant: str, words: str, trial: "Trial") -> "list[EpisodeResult]":
    from rich.console import Console
    from rich.progress import Progress

    from mbot_workstation.training.evaluation.episodes import evaluate as run

    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task(words, total=trial.episodes)
        return run(contestant, trial, lambda ended: progress.update(task, completed=ended))


def _lesson(name: str) -> "Lesson":
    from mbot_workstation.training.worlds.lessons import lesson

    try:
        return lesson(name)
    except ValueError as error:
        raise ConfigurationError(f"--lesson: {error}") from None


def _presets(names: list[str], calibrated: "CalibrationFiles | None") -> "dict[str, EffectRanges]":
    from mbot_workstation.variation.presets import PRESETS, preset

    if "all" in names:
        names = [name for name in PRESETS if calibrated is None or name != "ideal"]
    try:
        ranges = preset if calibrated is None else calibrated.ranges
        return {name: ranges(name) for name in names}
    except ValueError as error:
        raise ConfigurationError(f"--preset: {error}") from None


def _titles(contestants: list[str]) -> dict[str, str]:
    """Contestants by their names in tables; two files of the same name keep their paths."""
    from mbot_workstation.training.drivers.contestants import title

    short = [title(contestant) for contestant in contestants]
    return {
        contestant: contestant if short.count(name) > 1 else name
        for contestant, name in zip(contestants, short, strict=True)
    }
