"""How a run is to learn: its learner, steps, lessons and rooms from what a person asked for."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.learn.learning.colour_turn import hue_turn_deg
from mbot_workstation.learn.learning.curriculum import GUIDED_MARK
from mbot_workstation.learn.learning.learner import FINE_TUNING, GUIDED
from mbot_workstation.learn.learning.policy_source import find_source
from mbot_workstation.learn.learning.run_directory import RunDirectory
from mbot_workstation.learn.learning.training_config import (
    REAL_SHARE,
    TrainingConfig,
    read_config,
)
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.effects.presets import NOMINAL
from mbot_workstation.tasks.find import DEFAULT_TASK, find_task, is_file
from mbot_workstation.tasks.lesson import lessons_named
from mbot_workstation.tasks.task import Task

MADE_UP_ROOMS = 8
"""Beside the photographs that ship with the project."""

GUIDED_DECISIONS, STEPS = 360_000, 560_000
"""What ships had 1,500,000 of 1,600,000, with a smaller network that was not taught to see before.
PPO alone is what follows the guide: with 200,000 decisions of it one run came to 20.03 on nominal
robots, with 40,000 another to 20.00 (docs/notebook/training.md)."""

NEW_OBJECT_GUIDED, NEW_OBJECT_STEPS = 240_000, 300_000
"""One training for the blue bottle was at 19.86 after this; no other split was tried."""

DRIVES_GUIDED, DRIVES_STEPS = 240_000, 120_000
"""With drives: some minutes, in which the guide's weight falls to a half. What hands did is
rehearsed to the end, since PPO alone, in simulation, would make the policy forget it."""

MORE_PICTURES = 200_000
"""By which an eye that has learned to see learns what else a task or an object looks like."""

ROUND_STEPS = 200_000
"""What a run may be told to make besides, in an example."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunPlan:
    """What a person asked for; None or empty is what such a run usually has.

    Attributes:
        parent: a run or checkpoint to start from.
        guide: decisions during which a guide teaches.
        steps: decisions of all robots together.
        lessons: by name or range.
        memory_units: numbers that the policy remembers.
        panoramas: photographs of rooms.
        made_up_rooms: generated ones besides.
        object_file: what there is to find.
        task: by its name or file.
        drives: recordings of robots, from whose hands it learns besides.
        real_share: of the sequences that are rehearsed.

    """

    parent: Path | None = None
    guide: int | None = None
    steps: int | None = None
    lessons: tuple[str, ...] = ()
    memory_units: int
    panoramas: tuple[Path, ...] = ()
    made_up_rooms: int | None = None
    object_file: Path | None = None
    task: str = DEFAULT_TASK
    drives: tuple[Path, ...] = ()
    real_share: float = REAL_SHARE

    def config(self, **settings: Any) -> TrainingConfig:
        """The configuration of a new run.

        Args:
            settings: of `TrainingConfig`, that follow from nothing else.

        Raises:
            ConfigurationError: lessons or files are none, or do not go together.

        """
        default = TrainingConfig()
        further = self.parent is not None
        new_object = further and self.object_file is not None
        task = find_task(self.task)
        guided = self._guided(task)
        learner, steps = default.learner, default.steps
        if further:
            learner, steps = FINE_TUNING, STEPS
        if guided:
            learner, steps = replace(GUIDED, guided_decisions=guided), STEPS
        if not self.memory_units:
            paper = default.learner
            learner = replace(
                learner, first_filter_px=paper.first_filter_px, residual=False, eye_pictures=0
            )
        if new_object or self.drives:
            steps = DRIVES_STEPS if self.drives else NEW_OBJECT_STEPS
        made_up = 0 if self.panoramas else MADE_UP_ROOMS
        config = TrainingConfig(
            steps=self.steps or steps,
            object_file=str(self.object_file.resolve()) if self.object_file else "",
            task=self.task,
            lessons=_names(task, self.lessons)
            if self.lessons
            else task.course(guided=guided > 0, further=further),
            pass_mark=GUIDED_MARK if guided else default.pass_mark,
            panoramas=tuple(str(path.resolve()) for path in self.panoramas),
            shipped_photographs=not self.panoramas,
            drives=tuple(str(path.resolve()) for path in self.drives),
            real_share=self.real_share,
            made_up_rooms=made_up if self.made_up_rooms is None else self.made_up_rooms,
            learner=replace(
                learner,
                memory_units=self.memory_units,
                # Short runs are to be short.
                eye_pictures=min(learner.eye_pictures, 2 * (self.steps or steps)),
            ),
            **settings,
        )
        if self.parent is not None:
            return _from_parent(config, self.parent, self.task)
        if config.stages()[0].needs_training and not guided:
            raise ConfigurationError(
                f"--lesson {config.lessons[0]} without a guide trains a trained model on: add "
                "--from RUN, such as runs/first, or --guide 400000"
            )
        return config

    def _guided(self, task: Task) -> int:
        """For how many decisions the task's guide is learned from."""
        has_guide = task.guide(1, NOMINAL, RobotParameters(), 0) is not None
        if self.guide and not has_guide:
            raise ConfigurationError(f"--guide: the task {task.name} has none; leave it out")
        usual = GUIDED_DECISIONS if self.parent is None else 0
        if self.parent is not None and self.object_file is not None:
            usual = NEW_OBJECT_GUIDED
        if self.drives:
            usual = DRIVES_GUIDED
        guided = usual if self.guide is None and has_guide else self.guide or 0
        if self.drives and not (guided and self.parent):
            raise ConfigurationError(
                "--drives trains a trained policy on, beside its task's guide: add --from RUN, and "
                "leave out --guide 0"
            )
        return guided


def _from_parent(config: TrainingConfig, parent: Path, task: str) -> TrainingConfig:
    """With the weights of another run, so with the pictures' filters that it has."""
    source = find_source(parent)
    before = read_config(source.run.config_file, task)
    sees_on = before.learner.residual and config.learner.guided_decisions > 0
    return replace(
        config,
        parent=str(source.checkpoint.resolve()),
        hue_turn_deg=hue_turn_deg(before.scene.objects[0], config.scene.objects[0]),
        learner=replace(
            config.learner,
            first_filter_px=before.learner.first_filter_px,
            residual=before.learner.residual,
            eye_pictures=min(config.learner.eye_pictures, MORE_PICTURES) if sees_on else 0,
        ),
    )


def _names(task: Task, selection: tuple[str, ...]) -> tuple[str, ...]:
    try:
        return lessons_named(task.lessons, selection)
    except ValueError as error:
        raise ConfigurationError(f"--lesson: {error}") from None


def resumed(
    run: RunDirectory,
    *,
    steps: int | None,
    target_reward: float | None,
    workers: int | None,
    device: str,
    task: str,
    is_undecided: Callable[[RunDirectory], bool],
) -> TrainingConfig:
    """The configuration with which a run goes on: its own, but for what is given.

    Args:
        run: that has begun.
        steps, target_reward, workers: None leaves them.
        device: not the run's, which may have begun on another machine.
        task: the file that is run, if the run learned a task of a file.
        is_undecided: whether a run that has made its steps has still to choose a checkpoint.

    Raises:
        ConfigurationError: nothing is left to do.

    """
    config = read_config(run.config_file, task)
    if is_file(task) and not is_file(config.task):
        raise ConfigurationError(f"{run.path} learned {config.task}: leave out --task")
    wanted, done = steps or config.steps, _done(run)
    if done >= wanted and not (steps is None and is_undecided(run)):
        raise ConfigurationError(
            f"{run.path} has made {done:,} decisions already, {wanted:,} are asked for; give "
            f"--steps more than that, such as --steps {done + ROUND_STEPS}"
        )
    return replace(
        config,
        steps=wanted,
        target_reward=config.target_reward if target_reward is None else target_reward,
        workers=config.workers if workers is None else workers,
        device=device_named(device),
    )


def rounded_steps(run: RunDirectory, config: TrainingConfig) -> tuple[int, int]:
    """How many decisions it will have made at its end, and how many are learned from at a time:
    whole rollouts of every robot, whatever was asked for.
    """
    done = _done(run)
    rollout = config.learner.steps_per_robot * config.robots
    return done - (done - config.steps) // rollout * rollout, rollout


def _done(run: RunDirectory) -> int:
    checkpoints = run.checkpoints()
    return int(checkpoints[-1].name) if checkpoints else 0


def device_named(name: str) -> str:
    """The device that --device means; raises ConfigurationError if there is none such."""
    if name == "auto":
        return "cuda" if torch.cuda.is_available() else "cpu"
    if name.startswith("cuda") and not torch.cuda.is_available():
        raise ConfigurationError("--device cuda: torch finds no CUDA GPU here; use cpu")
    if name.partition(":")[0] not in ("cpu", "cuda"):
        raise ConfigurationError(f"--device is {name!r}, expected auto, cpu or cuda")
    return name
