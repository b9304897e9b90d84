"""Fetch with rewards of your own beside the paper's: each a function of what happened just now."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from numbers import Real
from typing import Any

import numpy as np

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.sim.pose import ORIGIN, Pose
from mbot_workstation.tasks.episode import Moment, Setting, Step
from mbot_workstation.tasks.fetch.episode import FACTS, FetchEpisode, from_robot
from mbot_workstation.tasks.fetch.lessons import FetchLesson
from mbot_workstation.tasks.fetch.rules import FetchRules
from mbot_workstation.tasks.fetch.task import TouchTask, rules_in


@dataclass(frozen=True, slots=True)
class Situation:
    """What a reward may look at, after some centimetres driven.

    Attributes:
        elapsed_s: since the last one, 0.01 s or more; rewards by the second are multiplied by it.
        robot: where it is, in metres and radians from the arena's middle.
        object: where the object is, the one that was there until now.
        bearing_rad: in which direction from the robot, left positive.
        away_m: how far from it.
        nearer_m: by how much the robot came nearer to it; less than 0 if it went away.
        driven_m, turned_rad: how far it drove and turned, to the left positive.
        object_s: for how long the object has been there.
        touching: how many things that are not the object it touches.
        happening: what of the task's happenings this brought.

    """

    elapsed_s: float
    robot: Pose
    object: Pose
    bearing_rad: float
    away_m: float
    nearer_m: float
    driven_m: float
    turned_rad: float
    object_s: float
    touching: int
    happening: str


Reward = Callable[[Situation], float]


class PaidRun(FetchEpisode):
    """One run."""

    def __init__(
        self, rules: FetchRules, rng: np.random.Generator, rewards: tuple[Reward, ...]
    ) -> None:
        super().__init__(rules, rng)
        self._rewards, self._paid = rewards, [0.0] * len(rewards)
        self._before = ORIGIN

    def advance(self, robot: Pose, elapsed_s: float) -> Step:
        """As the paper's, and the rewards."""
        was, before = self.target, self._before
        step = super().advance(robot, elapsed_s)
        ahead_m, left_m = from_robot(robot, was)
        turned = (robot.yaw_rad - before.yaw_rad + math.pi) % (2 * math.pi) - math.pi
        now = Situation(
            elapsed_s,
            robot,
            was,
            bearing_rad=math.atan2(left_m, ahead_m),
            away_m=math.hypot(ahead_m, left_m),
            nearer_m=math.hypot(*from_robot(before, was)) - math.hypot(ahead_m, left_m),
            driven_m=math.hypot(robot.x_m - before.x_m, robot.y_m - before.y_m),
            turned_rad=turned,
            object_s=self.object_s,
            touching=len(self._touching),
            happening=step.happening,
        )
        extra = [_paid_by(reward, now) for reward in self._rewards]
        self._before = ORIGIN if step.robot_to_origin else robot
        self._paid = [paid + more for paid, more in zip(self._paid, extra, strict=True)]
        self._score += sum(extra)
        return replace(step, score=step.score + sum(extra))

    def facts(self, moment: Moment) -> tuple[Any, ...]:
        """As the paper's, and what each reward has paid."""
        return (*super().facts(moment), *self._paid)


def _paid_by(reward: Reward, now: Situation) -> float:
    """What a user's function says; raises ConfigurationError if that is no number."""
    paid = reward(now)
    if not isinstance(paid, Real):  # numpy's are Real, and so is what is not finite
        raise ConfigurationError(f"the reward {reward.__name__} gave {paid!r}, expected a number")
    return float(paid)


class PaidFetch(TouchTask):
    """Derive from it and name the rewards; everything else of fetch can be changed as well.

    Attributes:
        rewards: beside what the paper's task pays.

    """

    rewards: tuple[Reward, ...] = ()

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        cls.terms = tuple(reward.__name__ for reward in cls.rewards)
        for name in cls.terms:
            if cls.terms.count(name) > 1 or name in (FACTS.names or ()):
                raise ConfigurationError(
                    f"a reward is called {name}, as another one or a fact is; call it otherwise"
                )
        cls.facts = np.dtype([*FACTS.descr, *((name, np.float32) for name in cls.terms)])

    def begin(self, lesson: FetchLesson, setting: Setting, rng: np.random.Generator) -> PaidRun:
        """Start a run."""
        return PaidRun(rules_in(lesson, setting), rng, self.rewards)
