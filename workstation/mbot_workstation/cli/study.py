"""`workstation study`: what a policy bears, as a table and a picture."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mbot_protocol.did_you_mean import did_you_mean
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.files import atomic_file
from mbot_workstation.cli.options import argument, option, output_folder, with_options
from mbot_workstation.cli.simulation_options import calibration_option, task_option

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from mbot_workstation.learn.evaluation.episodes import Trial
    from mbot_workstation.learn.evaluation.evaluation_report import Line
    from mbot_workstation.learn.studies.study_run import Condition

TOLERANCE = "tolerance"
NAMES = ("handicap", "blur", "latency", "robots", TOLERANCE)


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyOptions:
    """What `study` takes."""

    name: str = argument(f"One of {', '.join(NAMES)}.", metavar="STUDY")
    contestants: list[str] = argument(
        "ONNX policies, servo, random or oracle; as in evaluate.", metavar="MODEL..."
    )
    output: Path | None = output_folder(
        None,
        "For the page and the picture; `studies` beside the first policy if not given.",
        "--output",
        "-o",
        metavar="FOLDER",
    )
    episodes: int | None = option(
        None, "For each of them under each condition; 50, or 12 for tolerance.", min=1
    )
    task: str = task_option()
    lesson: str | None = option(
        None, "Of the task; of fetch 1 to 10, blur or rough, 10 if not given.", metavar="NAME"
    )
    calibration: Path | None = calibration_option()
    panorama: list[Path] | None = option(
        None, "Room to try it in; may be given several times.", metavar="FILE"
    )
    seed: int = option(0, "Of rooms, robots and objects.")
    pair: list[str] | None = option(
        None,
        "For tolerance: two deviations, such as fov_scale:camera_pitch_deg; may be given "
        "several times; five usual pairs if not.",
        metavar="A:B",
    )
    cells: int = option(7, "For tolerance: values of each deviation.", min=2, max=25)
    backend: str = option("threading", "Of joblib: threading (this machine's cores), dask or ray.")


@with_options
def study(options: StudyOptions) -> None:
    """Try policies under one condition after the other, and write what comes out.

    - **handicap**: one motor at 50 %
    - **blur**: exposure from 0 to 60 ms; give the models before and after the blur lesson
    - **latency**: 0 to 600 ms from picture to wheels
    - **robots**: all perturbed robots
    - **tolerance**: maps over pairs of deviations, of the first MODEL; also as numbers, in
      tolerance.json, for `workstation gap-report`

    Examples:

    - `workstation study latency policy.onnx servo`
    - `workstation study blur before.onnx after.onnx -o docs/results`
    - `workstation study tolerance policy.onnx --pair track_scale:fov_scale --cells 9`
    - `workstation study robots policy.onnx --calibration calibration/mbot-1 -o results`
    """
    from mbot_workstation.cli.simulation_options import find_lesson, photographs
    from mbot_workstation.learn.drivers.contestants import check_contestants
    from mbot_workstation.learn.evaluation.episodes import Trial
    from mbot_workstation.learn.studies.study_plans import study_plan
    from mbot_workstation.learn.studies.study_report import write_report
    from mbot_workstation.learn.studies.study_run import run_study
    from mbot_workstation.learn.worlds.rooms import evaluation_rooms
    from mbot_workstation.sim.calibrated.calibration_folder import files_to_simulate
    from mbot_workstation.sim.effects.presets import preset
    from mbot_workstation.tasks.find import full_reference

    _check_name(options.name)
    check_contestants(options.contestants)
    stage = find_lesson(options.lesson, options.task)
    files = files_to_simulate(options.calibration)
    robots = files.ranges if options.calibration else preset
    photos = photographs(options.panorama, options.calibration)
    rooms = evaluation_rooms(photos)
    number = options.episodes or (12 if options.name == TOLERANCE else 50)
    task, nominal = full_reference(options.task), robots("nominal")
    trial = Trial(stage, nominal, rooms, number, options.seed, None, files.robot, files.scene, task)
    how = _how(options, stage.name, number, len(rooms), photographed=bool(photos))

    def run(conditions: "Sequence[Condition]", drivers: "Sequence[str]") -> "list[Line]":
        words = f"{options.name}: {len(conditions)} conditions"
        return _with_bar(
            words,
            len(conditions) * len(drivers),
            lambda ended: run_study(conditions, drivers, trial, options.backend, ended),
        )

    folder = options.output or _beside(options.contestants)
    if options.name == TOLERANCE:
        page = _tolerance(options, folder, run, trial, how)
    else:
        plan = study_plan(options.name, robots)
        lines = run(plan.conditions, options.contestants)
        page = write_report(plan, lines, folder, how, trial)
    print(f"wrote {page}")


def _check_name(name: str) -> None:
    if name not in NAMES:
        meant = did_you_mean(name, NAMES)
        raise ConfigurationError(f"no study {name!r}, expected one of {', '.join(NAMES)}{meant}")


def _beside(contestants: "Sequence[str]") -> Path:
    """The folder `studies` where the first policy's file is, or here if all are built in."""
    files = [Path(name) for name in contestants if Path(name).is_file()]
    return (files[0].parent if files else Path()) / "studies"


def _how(
    options: StudyOptions, lesson: str, episodes: int, rooms: int, *, photographed: bool
) -> str:
    """How it was tried, for the page."""
    from mbot_workstation.learn.evaluation.provenance import provenance

    kind = "photographed" if photographed else "made-up"
    # A calibration's own room may be one the policy was trained in.
    seen = "" if options.calibration else " never trained in"
    robot = f" Nominal here is the robot of {options.calibration}." if options.calibration else ""
    return (
        f"Lesson {lesson}, {episodes} episodes a line, {rooms} {kind} rooms{seen}, seed "
        f"{options.seed}; "
        f"intervals of 95 %.{robot}\n\n{provenance(options.contestants)}"
    )


def _with_bar(
    words: str, total: int, work: "Callable[[Callable[[int], None]], list[Line]]"
) -> "list[Line]":
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task(words, total=total)
        return work(lambda ended: progress.update(task, completed=ended))


def _tolerance(
    options: StudyOptions,
    folder: Path,
    run: "Callable[[Sequence[Condition], Sequence[str]], list[Line]]",
    trial: "Trial",
    how: str,
) -> Path:
    from mbot_workstation.learn.studies.study_plans import PAIRS
    from mbot_workstation.learn.studies.study_report import make_folder
    from mbot_workstation.learn.studies.study_run import Condition
    from mbot_workstation.learn.studies.tolerance_file import TOLERANCE_FILE, write_tolerances
    from mbot_workstation.learn.studies.tolerance_map import (
        ToleranceMap,
        as_file,
        draw_maps,
        map_page,
    )

    names = [tuple(text.split(":")) for text in options.pair] if options.pair else list(PAIRS)
    if any(len(two) != 2 for two in names):
        raise ConfigurationError(
            f"--pair is {options.pair}, expected two names such as track_scale:fov_scale"
        )
    maps = [ToleranceMap.of(across, up, options.cells) for across, up in names]
    contestant, robot = options.contestants[0], trial.preset
    make_folder(folder)
    (nominal,) = run([Condition("nominal", robot)], [contestant])
    reward = nominal.score.reward.mean
    found = [(one, one.rewards(run(one.conditions(robot), [contestant]))) for one in maps]
    picture = folder / f"{TOLERANCE}.png"
    draw_maps(found, picture, nominal_reward=reward, largest=trial.lesson.largest_reward)
    page = folder / f"{TOLERANCE}.md"
    text = map_page(found, nominal.contestant, reward, how, picture.name)
    atomic_file.save(page, text.encode())
    if reward > 0:  # otherwise there is nothing that could be tolerated
        numbers = as_file(found, nominal.contestant, reward, how)
        print(f"wrote {write_tolerances(folder / TOLERANCE_FILE, numbers)}")
    return page
