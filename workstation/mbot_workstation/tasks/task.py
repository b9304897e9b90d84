"""What a task is. Worlds, learner, evaluation, virtual robot and films know this file and no task.

A task is an object named TASK in a module: in a folder here, or in a file of your own
(`workstation train --task my_task.py`). It says what stands in the arena, when an episode ends and
what a step is worth; robots, cameras, latencies and physics are none of its business.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.effects.effects import EffectRanges
from mbot_workstation.sim.scene.scene_look import Distractor
from mbot_workstation.sim.scene.scene_parameters import SceneParameters
from mbot_workstation.tasks.episode import Episode, Guide, Setting
from mbot_workstation.tasks.lesson import Lesson
from mbot_workstation.tasks.sight import Sight

Expert = Callable[[Sequence[Mapping[str, Any]]], NDArray[np.float32]]
"""From the infos of n robots to their wheels, shape (n, 2): an upper bound for evaluations."""


@dataclass(frozen=True, slots=True)
class Reference:
    """What a publication reached: mean reward of an episode, decisions for each one counted."""

    reward: float
    decisions: float


class Task(Protocol):
    """What robots are to do. Derive from it: what it can leave out has a default.

    Attributes:
        name: one word; models and runs carry it.
        counted: what an episode counts, as keys and columns name it, such as "touches"; one of
            `facts`, an integer.
        counted_one: one of them, for tables: "object".
        counted_done: what becomes of it, for people: "touched".
        happenings: what a step can bring, `episode.NOTHING` first.
        facts: what an episode says of itself at each decision, as a structured type.
        critic: those of `facts` that the critic is told, and the factor that brings each near 1.
        lessons: all there are; `course` says which are learned.
        sight: what its pictures show; None: a network learns that from driving alone.
        mistakes: those of `facts` that count what goes wrong without ending an episode.
        terms: those that say what an episode was paid so far by each term of its reward.

    """

    name: str
    counted: str
    counted_one: str
    counted_done: str
    happenings: tuple[str, ...]
    facts: "np.dtype[np.void]"
    critic: Mapping[str, float]
    lessons: tuple[Lesson, ...]
    sight: Sight | None = None
    mistakes: tuple[str, ...] = ()
    terms: tuple[str, ...] = ()

    def begin(self, lesson: Any, setting: Setting, rng: np.random.Generator) -> Episode:
        """Start an episode of one of its lessons, with the robot in the origin."""
        ...

    def pieces(self, _episode: Any, /) -> tuple[Distractor, ...]:
        """What stands or lies in the arena in this run, beside the scene's objects."""
        return ()

    def course(self, *, guided: bool, further: bool) -> tuple[str, ...]:
        """Names of the lessons to learn if not told: the last with a guide or a trained policy."""
        names = tuple(lesson.name for lesson in self.lessons)
        return names[-1:] if guided or further else names

    def play(self, reach_m: float | None, goal: int | None, *, ends_on_failure: bool) -> Lesson:
        """The lesson that a virtual robot plays, as far as a user says how.

        Args:
            reach_m: how far from the middle things appear.
            goal: how many make a complete run; 0 is no end.
            ends_on_failure: whether a failure ends the run, as in training.

        Raises:
            ValueError: this task can't be played so.

        """
        del ends_on_failure
        if reach_m is not None or goal is not None:
            raise ValueError(f"the task {self.name} sets its own distances and numbers")
        return self.lessons[-1]

    def scene(self, scene: SceneParameters) -> SceneParameters:
        """What stands in the arena, given what a user asks for."""
        return scene

    def guide(
        self, robots: int, ranges: EffectRanges, robot: RobotParameters, remembers: int
    ) -> Guide | None:
        """Somebody to learn from, who remembers for so many decisions; None: PPO alone."""
        del robots, ranges, robot, remembers
        return None

    def expert(self, robots: int, ranges: EffectRanges, robot: RobotParameters) -> Expert | None:
        """Somebody who is told the truth; None: nobody is."""
        del robots, ranges, robot
        return None

    def reference(self, lesson: Any) -> Reference | None:
        """What was published of this lesson."""
        del lesson
        return None

    def summary(self, result: Mapping[str, Any]) -> str:
        """An episode's result in a sentence."""
        return f"{result[self.counted]} {self.counted_done}; score {result['score']:.2f}"
