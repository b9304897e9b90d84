"""The paper's task as it runs: where the object is, how long it has been there, the score.

It is told where the robot is and says what happened; it moves nothing itself. Training and the
virtual robot both use it.
"""

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np

from mbot_workstation.sim.pose import ORIGIN, Pose
from mbot_workstation.sim.scene.target_object import Footprint
from mbot_workstation.tasks.fetch.rules import (
    COMPLETE_SCORE,
    FAILURE_SCORE,
    FetchRules,
    at_border,
    draw_kind,
    spawn,
    touch_score,
    touches,
)


class Happening(Enum):
    """What a step of the task brought."""

    NOTHING = "nothing"
    TOUCH = "touch"
    BORDER = "border"
    TIME_OUT = "time-out"


@dataclass(frozen=True, slots=True)
class TaskStep:
    """The outcome of one step.

    Attributes:
        happening: what happened.
        score: what it was worth.
        ended: whether the run is over.
        robot_to_origin: whether the robot has to be put back to the origin, heading along +x.

    """

    happening: Happening
    score: float = 0.0
    ended: bool = False
    robot_to_origin: bool = False

    @property
    def object_moved(self) -> bool:
        """Whether `FetchTask.target` is a new one."""
        return self.happening is not Happening.NOTHING and not self.ended


NOTHING = TaskStep(Happening.NOTHING)


@dataclass(frozen=True, slots=True)
class FetchResult:
    """A run in figures; every field is JSON.

    Attributes:
        touches: objects touched.
        seconds_per_touch: how long each of them took.
        border_contacts, time_outs: failures.
        completed: whether all objects were touched without a failure.
        score: in the paper's terms.
        distance_driven_m: of the axle's centre.
        duration_s: simulated time since the start.

    """

    touches: int
    seconds_per_touch: tuple[float, ...]
    border_contacts: int
    time_outs: int
    completed: bool
    score: float
    distance_driven_m: float
    duration_s: float


class FetchTask:
    """One run of the task.

    Attributes:
        rules: how it is set.
        target: where the object is now.
        kind: which of the rules' footprints it has.
        object_s: how long it has been there.
        ended: whether the run is over.

    """

    def __init__(self, rules: FetchRules, rng: np.random.Generator, robot: Pose = ORIGIN) -> None:
        self.rules = rules
        self._rng = rng
        self.begin(robot)

    def begin(self, robot: Pose = ORIGIN) -> None:
        """Start a new run with the robot where it is; the random numbers go on."""
        self._next_object(robot)
        self.ended = False
        self._robot = robot
        self._touch_s: list[float] = []
        self._failures = {Happening.BORDER: 0, Happening.TIME_OUT: 0}
        self._score = 0.0
        self._distance_m = 0.0
        self._duration_s = 0.0

    def advance(self, robot: Pose, elapsed_s: float) -> TaskStep:
        """Tell where the robot is now.

        Args:
            robot: its pose, at most some centimetres from the last one: contacts in between are
                not seen.
            elapsed_s: simulated time since the last call.

        """
        if self.ended:
            raise RuntimeError("the run has ended: begin() a new one")
        self.travel(robot, elapsed_s)
        self.object_s += elapsed_s
        if touches(robot, self.target, self.footprint, self.rules):
            return self._touched(robot)
        if at_border(robot, self.rules):
            return self._failed(Happening.BORDER)
        # Half a physics step: a sum of many small steps is not exact.
        if self.object_s >= self.rules.time_limit_s - 0.0025:
            return self._failed(Happening.TIME_OUT)
        return NOTHING

    def travel(self, robot: Pose, elapsed_s: float) -> None:
        """Count way and time only: as `advance`, where nobody looks at objects."""
        self._distance_m += math.hypot(robot.x_m - self._robot.x_m, robot.y_m - self._robot.y_m)
        self._duration_s += elapsed_s
        self._robot = robot

    def carried(self, robot: Pose) -> None:
        """Somebody has put the robot here, which is no way it drove."""
        self._robot = robot

    def result(self) -> FetchResult:
        """The run so far."""
        return FetchResult(
            touches=len(self._touch_s),
            seconds_per_touch=tuple(round(seconds, 3) for seconds in self._touch_s),
            border_contacts=self._failures[Happening.BORDER],
            time_outs=self._failures[Happening.TIME_OUT],
            completed=self._complete,
            score=round(self._score, 4),
            distance_driven_m=round(self._distance_m, 3),
            duration_s=round(self._duration_s, 3),
        )

    @property
    def footprint(self) -> Footprint:
        """Where the object stands, about `target`."""
        return self.rules.footprints[self.kind]

    @property
    def _all_touched(self) -> bool:
        return 0 < self.rules.objects <= len(self._touch_s)

    @property
    def _complete(self) -> bool:
        return self._all_touched and not any(self._failures.values())

    def _touched(self, robot: Pose) -> TaskStep:
        self._touch_s.append(self.object_s)
        score = touch_score(self.object_s, self.rules)
        if self._complete:
            score += COMPLETE_SCORE
        self._score += score
        self.ended = self._all_touched
        if not self.ended:
            self._next_object(robot)
        return TaskStep(Happening.TOUCH, score, self.ended)

    def _failed(self, how: Happening) -> TaskStep:
        self._failures[how] += 1
        self._score += FAILURE_SCORE
        self.ended = self.rules.ends_on_failure
        if not self.ended:
            self._robot = ORIGIN
            self._next_object(ORIGIN)
        return TaskStep(how, FAILURE_SCORE, self.ended, robot_to_origin=not self.ended)

    def _next_object(self, robot: Pose) -> None:
        self.target = spawn(robot, self.rules, self._rng)
        self.kind = draw_kind(self.rules, self._rng)
        self.object_s = 0.0
