"""`workstation evaluate`: how good is a policy?"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.cli.link_options import json_option
from mbot_workstation.cli.options import argument, option, output_file, with_options
from mbot_workstation.cli.output_paths import PICTURES
from mbot_workstation.cli.simulation_options import calibration_option, object_option, task_option

if TYPE_CHECKING:
    from rich.table import Table

    from mbot_workstation.learn.evaluation.episodes import EpisodeResult, Trial
    from mbot_workstation.sim.calibrated.calibration_folder import CalibrationFiles
    from mbot_workstation.sim.effects.effects import EffectRanges


@dataclass(frozen=True, slots=True, kw_only=True)
class EvaluateOptions:
    """What `evaluate` takes."""

    contestants: list[str] = argument(
        "ONNX policies, or servo (the colour servo), random, oracle (is told where the "
        "object is: an upper bound).",
        metavar="MODEL...",
    )
    episodes: int = option(100, "For each of them.", min=1)
    task: str = task_option()
    lesson: str | None = option(
        None, "Of the task; of fetch 1 to 10, blur or rough, 10 if not given.", metavar="NAME"
    )
    preset: list[str] | None = option(
        None,
        "Robots to try it on: ideal, nominal, randomised, or a perturbed one such as "
        "uneven, handicap, sluggish, slippery, blurry, noisy, distorted, dim, bright, late; "
        "all for every one. May be given several times; nominal if not.",
    )
    calibration: Path | None = calibration_option()
    object: Path | None = object_option()
    panorama: list[Path] | None = option(
        None,
        "360-degree photo of a room to try it in, in place of the two that come along; may be "
        "given several times.",
        metavar="FILE",
    )
    made_up_rooms: int | None = option(
        None,
        "Extra generated rooms, none of which training uses; 4 without a photo, 0 with one.",
        min=0,
        metavar="N",
    )
    seed: int = option(0, "Of rooms, robots and objects.")
    workers: int | None = option(None, "Processes; one a core if not given.", min=0)
    pictures: Path | None = option(
        None,
        "Instead of driving: what the policies do about the labelled pictures in this folder, by "
        "its truth.csv (file, in_view, bearing_left_deg).",
        metavar="FOLDER",
    )
    plot: Path | None = output_file(
        None, "Draw the comparison too.", endings=PICTURES, metavar="FILE.png"
    )
    film: Path | None = output_file(
        None,
        "Film one episode too, all MODELs side by side, on the first --preset.",
        endings=(".mp4",),
        metavar="FILE.mp4",
    )
    as_json: bool = json_option()


@with_options
def evaluate(options: EvaluateOptions) -> None:
    """Try policies on the paper's task: seeded episodes, means, 95 % confidence intervals.

    The paper's score on lesson 10 is a mean reward of 19.8 in 200 decisions, 20 an object; 21 is
    the most there is.

    Examples:

    - `workstation evaluate policy.onnx servo oracle --plot comparison.png`
    - `workstation evaluate policy.onnx servo --calibration calibration/mbot-1`
    - `workstation evaluate policy.onnx --preset slippery --preset uneven --panorama kitchen.jpg`
    - `workstation evaluate green-ball.onnx --object models/objects/green-ball.toml`
    - `workstation evaluate policy.onnx servo --episodes 16 --film side-by-side.mp4`
    - `workstation evaluate policy.onnx servo --pictures my-photos`
    """
    if options.pictures is not None:
        _judge_pictures(options, options.pictures)
    else:
        _drive(options)


def _judge_pictures(options: EvaluateOptions, folder: Path) -> None:
    import json

    from mbot_protocol.drive.calibration import read_camera
    from mbot_workstation.learn.drivers.contestants import BUILT_IN, SERVO, read_policy
    from mbot_workstation.learn.evaluation.labelled_pictures import (
        judge,
        observations,
        read_labelled,
    )
    from mbot_workstation.learn.evaluation.picture_report import picture_fields, picture_table

    if options.object is not None:
        raise ConfigurationError(
            "--object does nothing with --pictures, which show what they show: leave it out"
        )
    if blind := [name for name in options.contestants if name in BUILT_IN and name != SERVO]:
        raise ConfigurationError(f"{blind[0]} sees no pictures; give ONNX policies, or servo")
    calibrated = read_camera(options.calibration) if options.calibration else None
    camera = None if calibrated is None else calibrated.model()
    pictures = read_labelled(folder)
    names, bearings = [p.name for p in pictures], [p.bearing_left_deg for p in pictures]
    scores = {}
    for contestant, title in _titles(options.contestants).items():
        policy = read_policy(contestant)
        seen = observations(pictures, camera, policy.metadata.view)
        scores[title] = judge(policy.act(seen), bearings, names)
    if options.as_json:
        print(json.dumps([picture_fields(title, score) for title, score in scores.items()]))
    else:
        _print_table(picture_table(scores, f"{len(pictures)} pictures of {folder}"))


def _drive(options: EvaluateOptions) -> None:
    import json

    from mbot_workstation.cli.simulation_options import find_lesson, photographs
    from mbot_workstation.learn.drivers.contestants import check_contestants
    from mbot_workstation.learn.evaluation.episodes import Trial, score
    from mbot_workstation.learn.evaluation.evaluation_report import Line, draw, fields, table
    from mbot_workstation.learn.worlds.rooms import evaluation_rooms
    from mbot_workstation.sim.calibrated.calibration_folder import files_to_simulate
    from mbot_workstation.sim.scene.object_file import read_objects
    from mbot_workstation.tasks.find import find_task, full_reference

    check_contestants(options.contestants)
    task = find_task(options.task)
    files = files_to_simulate(options.calibration)
    scene = replace(files.scene, objects=read_objects(options.object))
    stage = find_lesson(options.lesson, options.task)
    robots = _presets(options.preset or ["nominal"], files if options.calibration else None)
    panorama = photographs(options.panorama, options.calibration)
    titles = _titles(options.contestants)
    rooms = evaluation_rooms(panorama, options.made_up_rooms)
    lines: list[Line] = []
    trials = {
        name: Trial(
            stage,
            effects,
            rooms,
            options.episodes,
            options.seed,
            options.workers,
            files.robot,
            scene,
            full_reference(options.task),
        )
        for name, effects in robots.items()
    }
    for name, trial in trials.items():
        for contestant, title in titles.items():
            results = _with_bar(contestant, f"{title}, {name}", trial)
            lines.append(Line(title, name, score(results)))
    if options.film is not None:
        from mbot_workstation.learn.evaluation.episode_film import film_episode

        contestants = {title: contestant for contestant, title in titles.items()}
        film_episode(contestants, next(iter(trials.values())), options.film)
    if options.plot is not None:
        draw(lines, options.plot, next(iter(trials.values())))
    if options.as_json:
        print(json.dumps([fields(line, lines, task) for line in lines]))
    else:
        heading = (
            f"lesson {stage.name}, {options.episodes} episodes each, {len(rooms)} rooms, "
            f"seed {options.seed}"
        )
        _print_table(table(lines, heading, task))


def _print_table(made: "Table") -> None:
    from rich.console import Console

    Console().print(made)


def _with_bar(contestant: str, words: str, trial: "Trial") -> "list[EpisodeResult]":
    from rich.console import Console
    from rich.progress import Progress

    from mbot_workstation.learn.evaluation.episodes import evaluate as run

    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task(words, total=trial.episodes)
        return run(contestant, trial, lambda ended: progress.update(task, completed=ended))


def _presets(names: list[str], calibrated: "CalibrationFiles | None") -> "dict[str, EffectRanges]":
    from mbot_workstation.sim.effects.presets import PRESETS, preset

    if "all" in names:
        names = [name for name in PRESETS if calibrated is None or name != "ideal"]
    try:
        ranges = preset if calibrated is None else calibrated.ranges
        return {name: ranges(name) for name in names}
    except ValueError as error:
        raise ConfigurationError(f"--preset: {error}") from None


def _titles(contestants: list[str]) -> dict[str, str]:
    """Contestants by their names in tables; two files of the same name keep their paths."""
    from mbot_workstation.learn.drivers.contestants import title

    short = [title(contestant) for contestant in contestants]
    return {
        contestant: contestant if short.count(name) > 1 else name
        for contestant, name in zip(contestants, short, strict=True)
    }
