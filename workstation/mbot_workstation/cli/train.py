"""`workstation train`: a policy from simulation, or more of one."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from mbot_protocol.errors import ConfigurationError, InterruptedByUserError
from mbot_workstation.cli.link_options import json_option
from mbot_workstation.cli.options import option, with_options
from mbot_workstation.cli.simulation_options import (
    calibration_option,
    object_option,
    task_option,
)

if TYPE_CHECKING:
    from mbot_workstation.learn.learning.run_directory import RunDirectory
    from mbot_workstation.learn.learning.training_config import TrainingConfig
    from mbot_workstation.learn.learning.training_run import TrainingResult
    from mbot_workstation.tasks.task import Task

MEMORY_UNITS = 128
"""`learning/memory_policy.py` says the same; importing it takes seconds."""

MADE_UP_ROOMS = 8
"""Beside the photographs that ship with the project."""

GUIDED_DECISIONS, STEPS = 1_500_000, 1_600_000
"""What ships was trained so. Less may do: a run guided for 940,000 of 1,000,000 had 18.94 of 21 on
rough robots (18.62 to 19.24, 288 episodes, one seed), after 540,000 more, 500,000 of them guided,
19.12 (18.80 to 19.40) as the mean of checkpoints, 19.28 (19.05 to 19.48) as the last one."""

NEW_OBJECT_GUIDED, NEW_OBJECT_STEPS = 240_000, 300_000
"""One training for the blue bottle was at 19.86 after this; no other split was tried."""

ROUND_STEPS = 200_000
"""What a run may be told to make besides, in an example."""

_WHAT, _ROOMS, _HOW = "What to learn", "Rooms", "How"


@dataclass(frozen=True, slots=True, kw_only=True)
class TrainOptions:
    """What `train` takes."""

    name: str | None = option(None, "Of the run, a folder in --runs; date and time if not given.")
    runs: Path = option(Path("runs"), "Where runs are kept.", metavar="FOLDER")
    resume: Path | None = option(
        None,
        "Go on with this run from its last checkpoint, as it was configured; only "
        "--steps, --target-reward, --workers and --device can be given anew.",
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
        "Decisions of all robots together; 1,600,000 if not given, 300,000 with --from and "
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
        "randomised",
        "Effects of the real world: ideal, nominal (all at their measured values, as in "
        "the paper), randomised, or sharp (randomised, but nothing ever blurs).",
        panel=_WHAT,
    )
    calibration: Path | None = calibration_option()
    object: Path | None = object_option()
    guide: int | None = option(
        None,
        "For the first N decisions learn from a guide as well, which knows what the robot is like "
        "and where the object is while the camera can see it; its weight falls to 0. 1,500,000 if "
        "not given, 0 with --from, 240,000 with --from and --object; 0 is PPO alone, as in the "
        "paper.",
        panel=_WHAT,
        metavar="N",
        min=0,
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
def train(options: TrainOptions) -> None:
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
    - `workstation train --resume runs/first --steps 2000000`
    - `workstation train --name paper --guide 0 --memory 0`
    - `workstation train --lesson blur --from runs/first --steps 300000`
    """
    import json
    from dataclasses import asdict

    from mbot_workstation.wording import typed

    run, config = _resumed(options) if options.resume is not None else _begun(options)
    _say_rounding(run, config)
    try:
        result = _train_until_stopped(run, config)
    except BaseException:
        if options.resume is None:
            run.forget_unless_begun()
        raise
    if options.as_json:
        print(json.dumps(asdict(result)))
    else:
        reward = "unknown" if result.mean_reward is None else f"{result.mean_reward:.2f}"
        print(
            f"{result.run}: {result.step:,} decisions in {result.wall_s / 60:.1f} minutes, lesson "
            f"{result.lesson}, mean reward {reward} of the latest episodes"
        )
    if result.reason == "interrupted":
        raise InterruptedByUserError(
            f"interrupted and saved; go on with --resume {typed(result.run)}"
        )
    if not options.as_json:
        print(f"next: workstation export {typed(result.run)}")


def _resumed(options: TrainOptions) -> tuple["RunDirectory", "TrainingConfig"]:
    from mbot_workstation.learn.evaluation.checkpoint_choice import is_undecided
    from mbot_workstation.learn.learning.run_directory import RunDirectory
    from mbot_workstation.learn.learning.training_config import read_config

    given = (options.name, options.lesson, options.parent, options.panorama)
    if any(given) or options.calibration or options.object:
        raise ConfigurationError(
            "--resume goes on with a run as it was configured; leave out --name, --lesson, "
            "--from, --panorama, --calibration and --object, or start a new run with --from"
        )
    assert options.resume is not None
    run = RunDirectory.open(options.resume)
    config = read_config(run.config_file)
    checkpoints, steps = run.checkpoints(), options.steps or config.steps
    done = int(checkpoints[-1].name) if checkpoints else 0
    if done >= steps and not (options.steps is None and is_undecided(run)):
        raise ConfigurationError(
            f"{options.resume} has made {done:,} decisions already, {steps:,} are asked for; give "
            f"--steps more than that, such as --steps {done + ROUND_STEPS}"
        )
    return run, replace(
        config,
        steps=steps,
        target_reward=config.target_reward
        if options.target_reward is None
        else options.target_reward,
        workers=config.workers if options.workers is None else options.workers,
        device=_device(options.device),  # not the run's: it may have begun on another machine
    )


def _say_rounding(run: "RunDirectory", config: "TrainingConfig") -> None:
    """Decisions are made in whole rollouts, one of every robot, whatever --steps says."""
    import sys

    checkpoints = run.checkpoints()
    done = int(checkpoints[-1].name) if checkpoints else 0
    rollout = config.learner.steps_per_robot * config.robots
    end = done - (done - config.steps) // rollout * rollout
    if end != config.steps:
        print(
            f"workstation: note: --steps {config.steps:,} becomes {end:,}: {rollout:,} decisions "
            "are learned from at a time",
            file=sys.stderr,
        )


def _begun(options: TrainOptions) -> tuple["RunDirectory", "TrainingConfig"]:
    from datetime import datetime

    from mbot_workstation.learn.learning.training_run import begin_run

    name = options.name or datetime.now().strftime("%Y-%m-%d-%H%M%S")
    if Path(name).name != name:
        raise ConfigurationError(
            f"--name is {name!r}, expected a folder's name without a path; --runs says where"
        )
    folder = options.runs / name
    config = _configured(options)
    return begin_run(folder, config), config


def _configured(options: TrainOptions) -> "TrainingConfig":
    """A new run's configuration."""
    from mbot_workstation.cli.simulation_options import photographs
    from mbot_workstation.learn.learning.curriculum import GUIDED_MARK
    from mbot_workstation.learn.learning.learner import FINE_TUNING, GUIDED
    from mbot_workstation.learn.learning.training_config import TrainingConfig
    from mbot_workstation.sim.calibrated.calibration_folder import files_to_simulate
    from mbot_workstation.tasks.find import find_task, full_reference

    rooms = photographs(options.panorama, options.calibration)
    default = TrainingConfig()
    further = options.parent is not None
    new_object = further and options.object is not None
    task = find_task(options.task)
    guided = _guided(task, options.guide, new_object=new_object, further=further)
    learner, steps = default.learner, default.steps
    if options.parent:
        learner, steps = FINE_TUNING, STEPS
    if guided:
        learner = replace(GUIDED, guided_decisions=guided)
        steps = STEPS
    if not options.memory:
        learner = replace(learner, first_filter_px=default.learner.first_filter_px)
    if new_object:
        steps = NEW_OBJECT_STEPS
    config = TrainingConfig(
        steps=options.steps or steps,
        robots=options.robots,
        workers=options.workers,
        seed=options.seed,
        preset=options.preset,
        calibration=files_to_simulate(options.calibration) if options.calibration else None,
        object_file=str(options.object.resolve()) if options.object else "",
        task=full_reference(options.task),
        lessons=_lessons(task, options.lesson)
        if options.lesson
        else task.course(guided=guided > 0, further=further),
        pass_mark=GUIDED_MARK if guided else default.pass_mark,
        panoramas=tuple(str(path.resolve()) for path in rooms),
        shipped_photographs=not rooms,
        made_up_rooms=(0 if rooms else MADE_UP_ROOMS)
        if options.made_up_rooms is None
        else options.made_up_rooms,
        target_reward=options.target_reward,
        device=_device(options.device),
        learner=replace(learner, memory_units=options.memory),
    )
    if options.parent is not None:
        return _from_parent(config, options.parent)
    if config.stages()[0].needs_training and not guided:
        raise ConfigurationError(
            f"--lesson {config.lessons[0]} without a guide trains a trained model on: add --from "
            "RUN, such as runs/first, or --guide 400000"
        )
    return config


def _guided(task: "Task", asked: int | None, *, new_object: bool, further: bool) -> int:
    """For how many decisions the task's guide is learned from."""
    from mbot_workstation.sim.body.robot_parameters import RobotParameters
    from mbot_workstation.sim.effects.presets import NOMINAL

    has_guide = task.guide(1, NOMINAL, RobotParameters(), 0) is not None
    if asked and not has_guide:
        raise ConfigurationError(f"--guide: the task {task.name} has none; leave it out")
    if asked is not None or not has_guide:
        return asked or 0
    return NEW_OBJECT_GUIDED if new_object else 0 if further else GUIDED_DECISIONS


def _from_parent(config: "TrainingConfig", parent: Path) -> "TrainingConfig":
    """With the weights of another run, so with the pictures' filters that it has."""
    from mbot_workstation.learn.learning.colour_turn import hue_turn_deg
    from mbot_workstation.learn.learning.policy_source import find_source
    from mbot_workstation.learn.learning.training_config import read_config

    source = find_source(parent)
    before = read_config(source.run.config_file)
    return replace(
        config,
        parent=str(source.checkpoint.resolve()),
        hue_turn_deg=hue_turn_deg(before.scene.objects[0], config.scene.objects[0]),
        learner=replace(config.learner, first_filter_px=before.learner.first_filter_px),
    )


def _lessons(task: "Task", selection: list[str]) -> tuple[str, ...]:
    from mbot_workstation.tasks.lesson import lessons_named

    try:
        return lessons_named(task.lessons, selection)
    except ValueError as error:
        raise ConfigurationError(f"--lesson: {error}") from None


def _device(name: str) -> str:
    import torch

    if name == "auto":
        return "cuda" if torch.cuda.is_available() else "cpu"
    if name.startswith("cuda") and not torch.cuda.is_available():
        raise ConfigurationError("--device cuda: torch finds no CUDA GPU here; use cpu")
    if name.partition(":")[0] not in ("cpu", "cuda"):
        raise ConfigurationError(f"--device is {name!r}, expected auto, cpu or cuda")
    return name


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
