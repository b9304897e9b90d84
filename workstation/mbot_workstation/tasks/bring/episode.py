"""A run of taking objects to a mat. To touch one is to have it: it is carried, out of sight."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from mbot_workstation.sim.pose import Pose
from mbot_workstation.sim.scene.scene_look import Distractor
from mbot_workstation.sim.scene.target_object import Footprint, Rgb
from mbot_workstation.tasks.episode import Moment, Step
from mbot_workstation.tasks.fetch.episode import FACTS as FETCH_FACTS
from mbot_workstation.tasks.fetch.episode import IN_VIEW_RAD, FetchEpisode, from_robot
from mbot_workstation.tasks.fetch.obstacles import way_to_things_m
from mbot_workstation.tasks.fetch.rules import FetchRules, touch_score
from mbot_workstation.tasks.floor.search import MIDDLE, Search

TAKEN, BROUGHT = "taken", "brought"

MAT_HALF_M, MAT_THICK_M = 0.15, 0.001
MAT_FROM_START_M = (0.5, 1.0)
"""Where it lies: within 1 m of the middle, from where it is in sight in all directions."""

MOST_TRIES = 50
"""To find a place where nothing else stands."""

OBJECT_FROM_MAT_M = 0.4

MAT_SEEN_M = 1.3
"""Further away it is less than a pixel high, for a camera 75 mm above the floor."""

FACTS = np.dtype(
    [*FETCH_FACTS.descr, ("brought", np.int32), ("carries", np.bool_), ("mat_left_rad", np.float32)]
)
"""Fetch's, of the mat while something is carried; objects brought so far; whether it carries one;
in which direction from the camera the picture shows the mat, left positive, pi from too far."""


class BringEpisode(FetchEpisode):
    """One run.

    Attributes:
        mat: where the mat lies.
        mat_rgb: its colour.

    """

    def __init__(self, rules: FetchRules, rng: np.random.Generator) -> None:
        for _ in range(MOST_TRIES):
            angle, away_m = rng.uniform(-math.pi, math.pi), rng.uniform(*MAT_FROM_START_M)
            turn = rng.uniform(-math.pi, math.pi)
            self.mat = Pose(away_m * math.cos(angle), away_m * math.sin(angle), turn)
            if way_to_things_m(self.mat, rules.standing, MAT_HALF_M) > 0:
                break
        self.mat_rgb: Rgb = (rng.uniform(0.02, 0.2), rng.uniform(0.4, 0.7), rng.uniform(0.1, 0.3))
        self._carries, self._taken = False, 0
        self._search = Search((MIDDLE,), MAT_SEEN_M)
        super().__init__(rules, rng)

    @property
    def footprint(self) -> Footprint:
        """Of the mat the middle of the robot has to be on it."""
        if not self._carries:
            return super().footprint
        half_m = MAT_HALF_M - self.rules.touch_radius_m
        return Footprint(half_m, half_m, 0.0)

    def places(self) -> Mapping[int, Pose]:
        """Where the object is, unless it is carried."""
        return {} if self._carries else super().places()

    def advance(self, robot: Pose, elapsed_s: float) -> Step:
        """As fetch; a search for the mat is counted."""
        self._search.advance(robot)
        return super().advance(robot, elapsed_s)

    def touched(self, robot: Pose) -> Step:
        """An object is taken; with one, the mat is reached."""
        if self._carries:
            self._carries = False
            return replace(super().touched(robot), happening=BROUGHT)
        score = touch_score(self.object_s, self.rules)
        self._score += score
        self._carries, self._taken = True, self._taken + 1
        self.target, self.object_s = self.mat, 0.0
        self._search.begin()
        return Step(TAKEN, score)

    def next_object(self, robot: Pose, rules: FetchRules | None = None) -> None:
        """Not on the mat."""
        while True:
            super().next_object(robot, rules)
            away_m = math.hypot(self.target.x_m - self.mat.x_m, self.target.y_m - self.mat.y_m)
            if away_m >= OBJECT_FROM_MAT_M:
                break
        self._carries = False

    def is_out_of_sight(self, eye: Pose) -> bool:
        """A mat is hidden by nothing but its distance."""
        return not self.sees_mat(eye) if self._carries else super().is_out_of_sight(eye)

    def aim_from(self, robot: Pose) -> Pose:
        """The mat itself: the robot drives onto it."""
        return self.mat if self._carries else super().aim_from(robot)

    def suspect(self, moment: Moment) -> tuple[float, float]:
        """From where the mat may be seen, after a turn in vain."""
        if not self._carries:
            return super().suspect(moment)
        place = self._search.goes_to
        return (math.inf, math.inf) if place is None else from_robot(moment.robot, place)

    def sees_mat(self, eye: Pose) -> bool:
        """Whether it is near enough."""
        return math.hypot(self.mat.x_m - eye.x_m, self.mat.y_m - eye.y_m) <= MAT_SEEN_M

    def facts(self, moment: Moment) -> tuple[Any, ...]:
        """FACTS at a decision."""
        ahead_m, left_m = from_robot(moment.seen_from, self.mat)
        left_rad = math.atan2(left_m, ahead_m - moment.camera_ahead_m)
        seen = left_rad if self.sees_mat(moment.seen_from) else math.pi
        if abs(seen) <= IN_VIEW_RAD:
            self._search.begin()
        return (*super().facts(moment), len(self._touch_s), self._carries, seen)

    def mat_piece(self) -> Distractor:
        """What is drawn."""
        size = (MAT_HALF_M, MAT_HALF_M, MAT_THICK_M / 2)
        place = (self.mat.x_m, self.mat.y_m, MAT_THICK_M / 2)
        return Distractor("box", size, place, self.mat.yaw_rad, self.mat_rgb)

    def result(self) -> Mapping[str, Any]:
        """The run so far."""
        fetched = super().result()
        return {**fetched, "taken": self._taken, "brought": fetched["touches"]}
