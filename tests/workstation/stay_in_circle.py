"""A second task, in one file: keep driving inside a circle of tape. Shows what a task needs."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mbot_workstation.sim.pose import ORIGIN, Pose
from mbot_workstation.sim.scene.scene_parameters import FloorMark, SceneParameters
from mbot_workstation.tasks.episode import NOTHING, Moment, Setting, Step
from mbot_workstation.tasks.lesson import Lesson
from mbot_workstation.tasks.task import Task

LEFT, DONE, METRE = "left", "done", "metre"
FACTS = np.dtype([("metres", np.int32), ("time_left_s", np.float32), ("to_tape_m", np.float32)])
LEAVING_SCORE = -1.0
METRE_SCORE = 0.5


@dataclass(frozen=True, slots=True)
class CircleLesson(Lesson):
    """How large the circle is, and for how long the robot must drive."""

    radius_m: float
    seconds: float

    @property
    def goal(self) -> int:
        """Metres, at a quarter of full speed."""
        return max(1, int(0.1 * self.seconds))


class Drive:
    """One run: a metre driven inside is worth something, leaving ends it."""

    def __init__(self, lesson: CircleLesson, setting: Setting) -> None:
        self._reach_m = lesson.radius_m - setting.contact_radius_m
        self._left_s = lesson.seconds
        self._robot = ORIGIN
        self._way_m = 0.0
        self._score = 0.0
        self.ended = False

    def places(self) -> Mapping[int, Pose]:
        """Nothing stands here."""
        return {}

    def free_way_m(self, robot: Pose) -> float:
        """To the tape."""
        return max(0.0, self._reach_m - math.hypot(robot.x_m, robot.y_m))

    def advance(self, robot: Pose, elapsed_s: float) -> Step:
        """Count the way; see whether it has left or is done."""
        metres = int(self._way_m)
        self._way_m += math.hypot(robot.x_m - self._robot.x_m, robot.y_m - self._robot.y_m)
        self._robot = robot
        self._left_s -= elapsed_s
        if self.free_way_m(robot) == 0:
            return self._happened(LEFT, LEAVING_SCORE, ended=True)
        if self._left_s <= 0:
            return self._happened(DONE, 1.0, ended=True)
        if int(self._way_m) > metres:
            return self._happened(METRE, METRE_SCORE, ended=False)
        return Step()

    def facts(self, moment: Moment) -> tuple[Any, ...]:
        """FACTS."""
        return int(self._way_m), self._left_s, self.free_way_m(moment.robot)

    def result(self) -> Mapping[str, Any]:
        """The run so far."""
        return {"metres": int(self._way_m), "score": round(self._score, 4)}

    def _happened(self, what: str, score: float, *, ended: bool) -> Step:
        self._score += score
        self.ended = ended
        return Step(what, score, ended)


class StayInCircle(Task):
    """Drive, and stay inside."""

    name = "stay-in-circle"
    counted, counted_one, counted_done = "metres", "metre", "driven"
    happenings = (NOTHING, LEFT, DONE, METRE)
    facts = FACTS
    critic: Mapping[str, float] = {"metres": 0.1, "time_left_s": 0.02, "to_tape_m": 1.0}
    lessons = (CircleLesson("wide", 1.5, 20.0), CircleLesson("narrow", 0.8, 60.0))

    def begin(self, lesson: CircleLesson, setting: Setting, rng: np.random.Generator) -> Drive:
        """Start a run in the middle."""
        del rng
        return Drive(lesson, setting)

    def scene(self, scene: SceneParameters) -> SceneParameters:
        """A circle of black tape on the floor."""
        angles = np.linspace(0, 2 * np.pi, 25)
        points = tuple((0.8 * math.cos(a), 0.8 * math.sin(a)) for a in angles.tolist())
        return replace(scene, marks=(FloorMark(points),))


TASK = StayInCircle()
