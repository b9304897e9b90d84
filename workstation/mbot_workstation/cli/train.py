"""Train policies: a run, its curve, and the file that robots take."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mbot_protocol.errors import ConfigurationError, InterruptedByUserError
from mbot_workstation.cli.common_options import (
    calibration_option,
    json_option,
    object_option,
    photographs,
    task_option,
)
from mbot_workstation.cli.options import (
    PICTURES,
    argument,
    check_new_file,
    option,
    output_file,
    with_options,
)
from mbot_workstation.cli.presenter import Answer, note
from mbot_workstation.wording import typed

if TYPE_CHECKING:
    from mbot_workstation.learn.learning.progress_log import ProgressRow
    from mbot_workstation.learn.learning.run_directory import RunDirectory
    from mbot_workstation.learn.learning.training_config import TrainingConfig
    from mbot_workstation.learn.learning.training_run import TrainingResult

MEMORY_UNITS = 128
"""`learning/memory_policy.py` says the same; importing it takes seconds."""

MORE_STEPS = 400_000
"""For a run that has learned little: with a guide lesson 10 is passed within 160,000."""

_WHAT, _ROOMS, _HOW = "What to learn", "Rooms", "How"


@dataclass(frozen=True, slots=True, kw_only=True)
class TrainOptions:
    """What `train` takes."""

    name: str | None = option(None, "Of the run, a folder in --runs; date and time if not given.")
    runs: Path = option(Path("runs"), "Where runs are kept.", metavar="FOLDER")
    resume: Path | None = option(
        None,
        "Go on with this run from its last checkpoint, as it was configured; only "
        "--steps, --target-reward, --workers and --device can be changed.",
        metavar="RUN",
    )
    task: str = task_option(_WHAT)
    lesson: list[str] | None = option(
        None,
        "One, a range such as 1-10, or several. If not given, 10 and then rough (any robot, also "
        "a worn one; any arena), rough alone with --from; from nothing with --guide 0 all ten. "
        "There is blur as well, for trained models.",
        panel=_WHAT,
        metavar="NAME",
    )
    parent: Path | None = option(
        None,
        "Start a new run with the weights of this run or checkpoint; with --object turned to its "
        "colour.",
        "--from",
        panel=_WHAT,
        metavar="RUN",
    )
    steps: int | None = option(
        None,
        "Decisions of all robots together; 560,000 if not given, 300,000 with --from and "
        "--object, 1,500,000 from nothing with --guide 0.",
        panel=_WHAT,
        min=1,
    )
    target_reward: float | None = option(
        None,
        "Stop early when 40,000 decisions of the last lesson have this mean reward, "
        "exploration included; the paper's plateau is 19.8.",
        panel=_WHAT,
        metavar="REWARD",
    )
    preset: str = option(
        "lived-in",
        "Effects of the real world: ideal, nominal (all at their measured values, as in "
        "the paper), randomised, lived-in (randomised, and most arenas are homes full of things), "
        "or sharp (randomised, but nothing ever blurs).",
        panel=_WHAT,
    )
    calibration: Path | None = calibration_option()
    object: Path | None = object_option()
    guide: int | None = option(
        None,
        "For the first N decisions learn from a guide as well, which knows what the robot is like "
        "and where the object is while the camera can see it; its weight falls to 0. 360,000 if "
        "not given, 0 with --from, 240,000 with --from and --object; 0 is PPO alone, as in the "
        "paper.",
        panel=_WHAT,
        metavar="N",
        min=0,
    )
    drives: Path | None = option(
        None,
        "With --from: learn from the hands on the drives kept for training in this folder, too.",
        panel=_WHAT,
        metavar="FOLDER",
    )
    real_share: float = option(
        0.25, "Of the sequences that are rehearsed.", panel=_WHAT, min=0.01, max=1
    )
    panorama: list[Path] | None = option(
        None,
        "360-degree photo of a room to train in, in place of the four that come along; may be "
        "given several times.",
        panel=_ROOMS,
        metavar="FILE",
    )
    made_up_rooms: int | None = option(
        None,
        "Extra generated rooms; 8 without a photo, 0 with one.",
        panel=_ROOMS,
        min=0,
        metavar="N",
    )
    memory: int = option(
        MEMORY_UNITS,
        "Numbers that the policy remembers from decision to decision; 0 is the paper's network.",
        panel=_HOW,
        metavar="N",
        min=0,
    )
    robots: int = option(16, "How many learn in parallel.", panel=_HOW, min=1)
    workers: int | None = option(
        None, "Processes that simulate them; one a core if not given.", panel=_HOW, min=0
    )
    seed: int = option(
        0, "The same seed gives the same run on the same kind of processor.", panel=_HOW
    )
    device: str = option(
        "auto",
        "Where the network learns: cpu, cuda, or auto, which takes a GPU if there is one.",
        panel=_HOW,
    )
    as_json: bool = json_option()


@with_options
def train(options: TrainOptions) -> Answer:
    """Train a policy in simulation: PPO, 16 robots at once, a guide for the beginning.

    Everything of a run is in its folder: configuration, state of the code, progress.csv, the last
    checkpoints, TensorBoard's files, and at the end the curve. At the end the checkpoints of the
    last fifth are tried in rooms that training never shows; the best one is the run's policy.
    Ctrl-C saves; a crash costs at most 40,000 decisions; `--resume` goes on.

    Examples:

    - `workstation train --name first`
    - `workstation train --name quick --lesson 10 --steps 409600`
    - `workstation train --panorama kitchen.jpg --panorama hall.jpg --seed 3`
    - `workstation train --calibration calibration/mbot-1`
    - `workstation train --object models/objects/green-ball.toml --from models/red-cube-run`
    - `workstation train --task my_task.py`
    - `workstation train --from models/red-cube-run --drives drives`
    - `workstation train --resume runs/first --steps 2000000`
    - `workstation train --name paper --guide 0 --memory 0`
    - `workstation train --lesson blur --from runs/first --steps 300000`
    """
    from mbot_workstation.learn.learning.run_plan import rounded_steps

    run, config = _resumed(options) if options.resume is not None else _begun(options)
    end, rollout = rounded_steps(run, config)
    if end != config.steps:
        note(
            f"--steps {config.steps:,} becomes {end:,}: {rollout:,} decisions are learned from at "
            "a time"
        )
    try:
        result = _train_until_stopped(run, config)
    except BaseException:
        if options.resume is None:
            run.forget_unless_begun()
        raise
    interrupted = InterruptedByUserError(
        f"interrupted and saved; go on with --resume {typed(result.run)}"
    )
    stopped = result.reason == "interrupted"
    half = next(one for one in config.stages() if one.name == result.lesson).largest_reward / 2
    return Answer(result, trained_words(result, half), error=interrupted if stopped else None)


def trained_words(result: "TrainingResult", half: float) -> Iterator[str]:
    """How it ended, and what is next: below half of the lesson's largest reward, more training."""
    reward = "unknown" if result.mean_reward is None else f"{result.mean_reward:.2f}"
    yield (
        f"{result.run}: {result.step:,} decisions in {result.wall_s / 60:.1f} minutes, lesson "
        f"{result.lesson}, mean reward {reward} of the latest episodes"
    )
    if result.reason == "interrupted":
        return
    if result.mean_reward is not None and result.mean_reward >= half:
        yield f"next: workstation export {typed(result.run)}"
    else:
        steps = result.step + MORE_STEPS
        yield (
            f"it has not learned much yet, {2 * half:g} is the most: train on; next: workstation "
            f"train --resume {typed(result.run)} --steps {steps}"
        )


def _resumed(options: TrainOptions) -> tuple["RunDirectory", "TrainingConfig"]:
    from mbot_workstation.learn.evaluation.checkpoint_choice import is_undecided
    from mbot_workstation.learn.learning.run_directory import RunDirectory
    from mbot_workstation.learn.learning.run_plan import resumed

    given = (options.name, options.lesson, options.parent, options.panorama, options.drives)
    if any(given) or options.calibration or options.object:
        raise ConfigurationError(
            "--resume goes on with a run as it was configured; leave out --name, --lesson, --from, "
            "--drives, --panorama, --calibration and --object, or start a new run with --from"
        )
    assert options.resume is not None
    run = RunDirectory.open(options.resume)
    config = resumed(
        run,
        steps=options.steps,
        target_reward=options.target_reward,
        workers=options.workers,
        device=options.device,
        task=options.task,
        is_undecided=is_undecided,
    )
    return run, config


def _begun(options: TrainOptions) -> tuple["RunDirectory", "TrainingConfig"]:
    from datetime import datetime

    from mbot_workstation.learn.learning.training_run import begin_run

    name = options.name or datetime.now().strftime("%Y-%m-%d-%H%M%S")
    if Path(name).name != name:
        raise ConfigurationError(
            f"--name is {name!r}, expected a folder's name without a path; --runs says where"
        )
    config = _configured(options)
    return begin_run(options.runs / name, config), config


def _configured(options: TrainOptions) -> "TrainingConfig":
    """A new run's configuration."""
    from mbot_workstation.learn.learning.run_plan import RunPlan, device_named
    from mbot_workstation.sim.calibrated.calibration_folder import files_to_simulate
    from mbot_workstation.tasks.find import full_reference

    return RunPlan(
        parent=options.parent,
        guide=options.guide,
        steps=options.steps,
        lessons=tuple(options.lesson or ()),
        memory_units=options.memory,
        panoramas=tuple(photographs(options.panorama, options.calibration)),
        made_up_rooms=options.made_up_rooms,
        object_file=options.object,
        task=full_reference(options.task),
        drives=_kept(options.drives) if options.drives else (),
        real_share=options.real_share,
    ).config(
        robots=options.robots,
        workers=options.workers,
        seed=options.seed,
        preset=options.preset,
        calibration=files_to_simulate(options.calibration) if options.calibration else None,
        target_reward=options.target_reward,
        device=device_named(options.device),
    )


def _kept(folder: Path) -> tuple[Path, ...]:
    """The drives that are kept for training."""
    from mbot_workstation.look.collect.reviews import drives_in, kept_for, read_review

    reviews = {path: read_review(path) for path in drives_in(folder)}
    if not (kept := kept_for(reviews, ("training",))["training"]):
        raise ConfigurationError(
            f"no drive in {folder} is kept for training: `workstation drives split {typed(folder)}`"
        )
    return tuple(kept)


def _train_until_stopped(run: "RunDirectory", config: "TrainingConfig") -> "TrainingResult":
    """Train; the first Ctrl-C ends the run with a checkpoint, the second one at once."""
    from mbot_workstation.cli.stop_signals import stop_signals
    from mbot_workstation.learn.evaluation.checkpoint_choice import choose_checkpoint
    from mbot_workstation.learn.learning.learning_curve import draw_curves
    from mbot_workstation.learn.learning.progress_display import display
    from mbot_workstation.learn.learning.progress_log import read_progress
    from mbot_workstation.learn.learning.training_run import train
    from mbot_workstation.tasks.find import find_task

    with stop_signals() as stop, display() as shown:
        result = train(run, config, shown, stop)
        if result.reason != "interrupted":
            choose_checkpoint(run, config, shown, stop)
    rows = read_progress(run.progress_file)
    if rows:
        draw_curves({run.path.resolve().name: rows}, find_task(config.task), run.curve_file)
    return result


@dataclass(frozen=True, slots=True, kw_only=True)
class TrainingCurveOptions:
    """What `training_curve` takes."""

    runs: list[Path] = argument("Folders of runs, all drawn into one picture.", metavar="RUN...")
    task: str = task_option()
    output: Path | None = output_file(
        None,
        "curve.png in the first run's folder if not given.",
        "--output",
        "-o",
        endings=PICTURES,
        metavar="FILE.png",
    )


@with_options
def training_curve(options: TrainingCurveOptions) -> Answer:
    """Draw reward, episode length and lesson over the decisions of runs, as the paper's Fig. 4.

    Examples:

    - `workstation training-curve runs/first -o curve.png`
    - `workstation training-curve runs/seed-1 runs/seed-2 runs/seed-3 -o seeds.png`
    """
    from mbot_workstation.learn.learning.learning_curve import draw_curves
    from mbot_workstation.learn.learning.run_directory import RunDirectory
    from mbot_workstation.learn.learning.training_config import read_config
    from mbot_workstation.tasks.find import find_task

    runs = {str(path): RunDirectory.open(path) for path in options.runs}
    if len(runs) == 1:
        runs = {run.path.resolve().name: run for run in runs.values()}
    drawn: dict[str, list[ProgressRow]] = {}
    said: list[str] = []
    for name, run in runs.items():
        drawn[name], words = _progress(run, options.task)
        said.append(f"{name}: {words}" if len(runs) > 1 else words)
    path = options.output or next(iter(runs.values())).curve_file
    learned = {read_config(run.config_file, options.task).task for run in runs.values()}
    if len(learned) > 1:
        raise ConfigurationError("these runs learned different tasks: draw a picture of each")
    draw_curves(drawn, find_task(learned.pop()), path)
    return Answer(str(path), [f"wrote {path}: {'; '.join(said)}"])


def _progress(run: "RunDirectory", task: str) -> tuple[list["ProgressRow"], str]:
    """A run's rows, and how far it is, in words."""
    from mbot_workstation.learn.learning.progress_display import clock
    from mbot_workstation.learn.learning.progress_log import ROW_EVERY, read_progress
    from mbot_workstation.learn.learning.training_config import read_config

    steps = read_config(run.config_file, task).steps
    rows = read_progress(run.progress_file) if run.progress_file.is_file() else []
    if not rows:
        raise ConfigurationError(
            f"{run.path} has no row in progress.csv yet: one comes every {ROW_EVERY:,} of its "
            f"{steps:,} decisions"
        )
    step, wall_s = rows[-1].step, rows[-1].wall_s
    if step < steps and wall_s > 0:
        left = clock((steps - step) * wall_s / step)
        return rows, f"{step:,} of {steps:,} decisions made, {left} of training to go"
    return rows, f"all {step:,} decisions made"


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportOptions:
    """What `export` takes."""

    source: Path = argument(
        "A run's folder, that of one checkpoint, or a policy that was exported before.",
        metavar="RUN",
    )
    output: Path | None = output_file(
        None, "A new file; RUN's name if not given.", "--output", "-o", metavar="FILE.onnx"
    )
    name: str | None = option(None, "What robots call it; the file's name if not given.")
    task: str = task_option()
    for_armv6: bool = option(
        False,
        "For a first Pi Zero, where OpenCV runs it: the same policy in an older dialect of ONNX.",
        "--for-armv6",
    )
    as_json: bool = json_option()


@with_options
def export(options: ExportOptions) -> Answer:
    """Write a trained policy as one ONNX file, ready for `workstation push-model`.

    The file says which run, code, lessons and rooms it comes from, and brings the frames of
    two drives with the actions they should give, so that anyone can check it.

    Examples:

    - `workstation export runs/first -o policy.onnx`
    - `workstation export runs/first/checkpoints/000400000 -o earlier.onnx`
    - `workstation export models/red-cube.onnx --for-armv6 -o red-cube-armv6.onnx`
    """
    from mbot_workstation.fleet.models.trained_object import trained_object
    from mbot_workstation.fleet.models.written_policy import write_policy
    from mbot_workstation.learn.learning.policy_export import export_policy
    from mbot_workstation.learn.learning.trained_policy import trained_policy

    if options.output is not None:
        check_new_file(options.output)  # before the work
    policy = trained_policy(options.source, options.task)
    path = options.output or Path(f"{policy.name}.onnx")
    check_new_file(path)
    name = options.name or path.stem
    model = export_policy(policy, name, for_armv6=options.for_armv6)
    made = write_policy(path, name, model, checkpoint=policy.checkpoint)
    thing = trained_object(path)
    told = thing.option if thing else ""
    if policy.object_file:  # where it is known, the file itself
        told = f" --object {typed(policy.object_file)}"
    return Answer(made, [made.sentence(f"workstation evaluate {typed(path)}{told}")])
