"""A task of your own, to begin with: touch objects, one after the other, and be paid on the way.

    workstation task check FILE.py
    workstation train --name mine --task FILE.py
    workstation evaluate --task FILE.py MODEL.onnx

It is the paper's task with other rewards; docs/tasks.md has what can be changed besides.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from mbot_workstation.sim.pose import ORIGIN, Pose
from mbot_workstation.tasks.episode import Setting, Step
from mbot_workstation.tasks.fetch.episode import FetchEpisode
from mbot_workstation.tasks.fetch.lessons import FetchLesson
from mbot_workstation.tasks.fetch.task import Fetch, rules_in


@dataclass(frozen=True, slots=True)
class Situation:
    """What a reward may look at, after some centimetres driven.

    Attributes:
        elapsed_s: since the last one, 0.02 s or more.
        nearer_m: by how much the robot came nearer to the object; less than 0 if it went away.
        driven_m: how far it drove.

    """

    elapsed_s: float
    nearer_m: float
    driven_m: float


def approach(now: Situation) -> float:
    """Pays for coming nearer and takes as much for going away, or to and fro would be paid."""
    return 0.2 * now.nearer_m


def haste(now: Situation) -> float:
    """Costs for every second, or standing would be as good as driving."""
    return -0.01 * now.elapsed_s


REWARDS: tuple[Callable[[Situation], float], ...] = (approach, haste)
"""Beside what the paper's task pays: 1 to 2 for an object, -1 for border and time-out, 1 at the
end."""


class PaidRun(FetchEpisode):
    """One run."""

    _before = ORIGIN

    def advance(self, robot: Pose, elapsed_s: float) -> Step:
        """As the paper's, and the rewards."""
        object_was, robot_was = self.target, self._before
        step = super().advance(robot, elapsed_s)
        nearer_m = _apart_m(robot_was, object_was) - _apart_m(robot, object_was)
        now = Situation(elapsed_s, nearer_m, _apart_m(robot_was, robot))
        extra = sum(reward(now) for reward in REWARDS)
        self._before = ORIGIN if step.robot_to_origin else robot
        self._score += extra
        return replace(step, score=step.score + extra)


class NewTask(Fetch):
    """One object nearby, then ten everywhere, each within the paper's 66.8 s."""

    name = "new-task"
    lessons = (FetchLesson("near", 1.0), FetchLesson("far", 2.5, objects=10))

    def begin(self, lesson: FetchLesson, setting: Setting, rng: np.random.Generator) -> PaidRun:
        """Start a run."""
        return PaidRun(rules_in(lesson, setting), rng)

    def course(self, *, guided: bool, further: bool) -> tuple[str, ...]:
        """The guide soon teaches the last one."""
        return ("far",) if guided or further else ("near", "far")


def _apart_m(one: Pose, other: Pose) -> float:
    return math.hypot(one.x_m - other.x_m, one.y_m - other.y_m)


TASK = NewTask()
