"""A training run, from nothing or from its last checkpoint, to its end."""

import json
import math
import threading
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch
from stable_baselines3.common.logger import Logger, TensorBoardOutputFormat

from mbot_workstation.learn.learning.checkpoint import read_state, restore_learner
from mbot_workstation.learn.learning.collection import Collection
from mbot_workstation.learn.learning.eye import take_stills, teach_eye
from mbot_workstation.learn.learning.git_state import git_state
from mbot_workstation.learn.learning.guidance import GUIDE_REMEMBERS
from mbot_workstation.learn.learning.hands_advice import hands_advice
from mbot_workstation.learn.learning.learner import make_learner
from mbot_workstation.learn.learning.picture_ppo import PicturePPO
from mbot_workstation.learn.learning.processor import keep_freed_memory, prepare_gpu
from mbot_workstation.learn.learning.progress_display import RunDisplay
from mbot_workstation.learn.learning.run_directory import RunDirectory, write_json
from mbot_workstation.learn.learning.sequences import LENGTH, Sequences
from mbot_workstation.learn.learning.training_callback import TrainingCallback
from mbot_workstation.learn.learning.training_config import TrainingConfig
from mbot_workstation.learn.worlds.rooms import training_rooms
from mbot_workstation.learn.worlds.task_vec_env import TaskVecEnv
from mbot_workstation.tasks.episode import Guide
from mbot_workstation.tasks.find import find_task


@dataclass(frozen=True, slots=True)
class TrainingResult:
    """How a run ended; JSON as it is.

    Attributes:
        run: its folder.
        reason: "steps", "target" or "interrupted".
        step: decisions made.
        wall_s: training time, over all resumptions.
        lesson: reached.
        mean_reward: of the latest 100 episodes, as the display shows it; None before the first.

    """

    run: str
    reason: str
    step: int
    wall_s: float
    lesson: str
    mean_reward: float | None


def begin_run(path: Path, config: TrainingConfig) -> RunDirectory:
    """Make a new run's folder, with all that is known before it starts.

    Raises:
        ConfigurationError: the folder exists, or can't be made.

    """
    run = RunDirectory.create(path)
    try:
        write_json(run.config_file, config.resolved())
        write_json(run.git_file, [])
    except BaseException:
        run.forget_unless_begun()
        raise
    return run


def train(
    run: RunDirectory, config: TrainingConfig, display: RunDisplay, stop: threading.Event
) -> TrainingResult:
    """Train until the steps are made, the target is reached or someone says stop.

    A run goes on from its last checkpoint, if there is one. Weights, optimiser, lessons and the
    learner's random numbers go on from there. The robots start new episodes, from a seed made of
    the run's and the step: what 16 simulations are in the middle of is not kept.

    Args:
        run: its folder.
        config: its configuration; steps and target may have changed since it began.
        display: shows it; entered already.
        stop: set it to end at the next decision, with a checkpoint. While the network learns to
            see there is none: who resumes such a run begins it again.

    """
    keep_freed_memory()
    prepare_gpu()
    torch.set_num_threads(1)  # PicturePPO has threads of its own, the robots have processes
    start = read_state(run.last_checkpoint()) if run.checkpoints() else None
    step = start.step if start else 0
    real = _real(config, display)  # before minutes have passed: something may be wrong with it
    _note_code(run, step)
    environment = environment_of(config, start.curriculum.index if start else 0, step)
    writer = TensorBoardOutputFormat(str(run.tensorboard))
    try:
        learner = make_learner(
            environment, config.learner, config.seed, config.device, environment.task.critic
        )
        guide_for = guides_of(config)
        learner.collection = Collection(environment, guide_for, config.seed + step)
        if start:
            restore_learner(run.last_checkpoint(), learner, with_optimizer=True)
            start.random.restore()
            learner.num_timesteps = step
        elif config.parent:
            restore_learner(
                Path(config.parent), learner, with_optimizer=False, turn_deg=config.hue_turn_deg
            )
        blind = _open_eye(learner, environment, config, stop, display, learned=start is not None)
        learner.rehearse_beside(real, config.real_share)
        learner.set_logger(Logger(str(run.tensorboard), [writer]))
        callback = TrainingCallback(run, config, environment, display, stop, start)
        if blind:
            callback.reason = "interrupted"
        elif step < config.steps:
            learner.learn(config.steps - step, callback=callback, reset_num_timesteps=not start)
            callback.save()
        return TrainingResult(
            run=str(run.path),
            reason=callback.reason,
            step=learner.num_timesteps,
            wall_s=round(callback.wall_s, 1),
            lesson=callback.lesson,
            mean_reward=callback.mean_reward,
        )
    finally:
        writer.close()
        environment.close()


def _real(config: TrainingConfig, display: RunDisplay) -> Sequences | None:
    """What the run learns from hands, cut as its rollouts are; raises ConfigurationError."""
    if not config.drives:
        return None
    length = math.gcd(config.learner.steps_per_robot, LENGTH)
    real = hands_advice(config.drives, length, config.learner.memory_units)
    beats = np.isfinite(real.advice[..., 0]).sum()
    display.say(f"{beats} beats by hand of {len(config.drives)} drives are advice")
    return real


def _open_eye(
    learner: PicturePPO,
    environment: TaskVecEnv,
    config: TrainingConfig,
    stop: threading.Event,
    display: RunDisplay,
    *,
    learned: bool,
) -> bool:
    """Let the learner see before it drives, if the run is to; whether someone said stop meanwhile.

    Args:
        learned: whether its network has learned to see, before the run was interrupted.

    """
    pictures, guide_for = config.learner.eye_pictures, guides_of(config)
    if not pictures or environment.task.sight is None:
        return False
    network, first = learner.policy.features_extractor, environment.lesson
    environment.set_lesson(config.stages()[-1])  # it sees robots of every kind, or never will
    # Who learns from drives has learned to see, and its wheels heed what its memory makes of that.
    if not learned and not config.drives:
        advice = teach_eye(network, environment, guide_for, pictures, stop, display.say)
        if advice is not None and guide_for is not None:
            learner.policy.begin_with(advice)
    if not stop.is_set():
        units = learner.policy.units
        stills = take_stills(network, environment, guide_for, pictures, units, stop)
        learner.keep_eye(stills)
    environment.set_lesson(first)
    return stop.is_set()


def environment_of(config: TrainingConfig, stage: int = 0, step: int = 0) -> TaskVecEnv:
    """Where a run learns from this lesson and this decision on."""
    rooms = training_rooms(config.photographs, config.made_up_rooms, config.scene.objects)
    return TaskVecEnv(
        robots=config.robots,
        seed=config.seed * config.robots + step,  # robots count up from it
        preset=config.ranges(),
        lesson=config.stages()[stage],
        rooms=rooms,
        workers=config.workers,
        robot=config.robot,
        scene=config.scene,
        task=config.task,
    )


def guides_of(config: TrainingConfig) -> Callable[[int], Guide | None] | None:
    """Makes a run's guide for so many robots; None without one."""
    if config.learner.guided_decisions <= 0:
        return None
    remembers = GUIDE_REMEMBERS if config.learner.memory_units else 0
    task = find_task(config.task)
    return lambda robots: task.guide(robots, config.ranges(), config.robot, remembers)


def _note_code(run: RunDirectory, step: int) -> None:
    """Add to git.json which code trains from this step on."""
    sessions = json.loads(run.git_file.read_text())
    write_json(run.git_file, [*sessions, {"from_step": step, **asdict(git_state())}])
