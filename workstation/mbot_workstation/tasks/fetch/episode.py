"""A run of the paper's task: where the object is, how long it has been there, the score."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from typing import Any

import numpy as np

from mbot_workstation.sim.pose import ORIGIN, Pose
from mbot_workstation.sim.scene.target_object import Footprint
from mbot_workstation.tasks.episode import DECISION_S, Moment, Step
from mbot_workstation.tasks.fetch.obstacles import aim_around, is_hidden
from mbot_workstation.tasks.fetch.rules import (
    COMPLETE_SCORE,
    FAILURE_SCORE,
    WRONG_SCORE,
    FetchRules,
    at_border,
    draw_kind,
    spawn,
    touch_score,
    touched_things,
    touches,
    way_to_contact_m,
)


class Happening(StrEnum):
    """What a step brings, if anything."""

    TOUCH = "touch"
    WRONG = "wrong thing"
    BORDER = "border"
    TIME_OUT = "time-out"
    STUCK = "stuck"


@dataclass(frozen=True, slots=True)
class FetchResult:
    """A run in figures; every field is JSON.

    Attributes:
        touches: objects touched.
        seconds_per_touch: how long each of them took.
        border_contacts, time_outs: failures.
        wrong_things: how often it ran into something that is not the object.
        completed: whether all objects were touched without a failure.
        score: in the paper's terms.

    """

    touches: int
    seconds_per_touch: tuple[float, ...]
    border_contacts: int
    time_outs: int
    wrong_things: int
    completed: bool
    score: float


FACTS = np.dtype(
    [
        ("touches", np.int32),
        ("time_left_s", np.float32),
        ("border", np.bool_),
        ("target_ahead_m", np.float32),
        ("target_left_m", np.float32),
        ("seen_left_rad", np.float32),
        ("aim_ahead_m", np.float32),
        ("aim_left_m", np.float32),
        ("suspect_ahead_m", np.float32),
        ("suspect_left_m", np.float32),
        ("wrong_things", np.int32),
    ]
)
"""Objects touched so far; how long this one may still take; whether the last happening was contact
with the border; where the object is, in the robot's frame; in which direction from the camera the
picture shows it, left positive, or would if it were in view. Pictures are old: in a turn that is
not where the object is now, NaN while they still show the one that was touched, and pi while
something hides it. Where to drive first, since something may stand in the way. Where something of
its colour is that the picture shows too small to tell it from the object, and that nobody has seen
from nearby since the object appeared; infinite without one. How often the robot ran into something
that is not the object."""

TOLD_APART_M = 1.0
"""From here a cube of 10 cm is 7 pixels wide: enough to see that it is none. Assumed."""

IN_VIEW_RAD = math.radians(27.0)
"""Half the camera's horizontal field of view."""

OBJECT_HEIGHT_M = 0.10
"""Nominal: what is much lower hides nothing."""

SLACK_S = 1e-6
"""Sums of decimal seconds are not exact."""


class FetchEpisode:
    """One run.

    Attributes:
        rules: how it is set.
        target: where the object is now.
        kind: which of the rules' footprints it has.
        object_s: how long it has been there.
        ended: whether the run is over.

    """

    def __init__(self, rules: FetchRules, rng: np.random.Generator) -> None:
        self.rules = rules
        self._rng = rng
        self.ended = False
        self._touch_s: list[float] = []
        self._wrong_things = 0
        self._touching: frozenset[int] = frozenset()
        self._failures = {Happening.BORDER: 0, Happening.TIME_OUT: 0, Happening.STUCK: 0}
        self._at_border = False
        self._score = 0.0
        self.next_object(ORIGIN)

    def places(self) -> Mapping[int, Pose]:
        """Where the object is."""
        return {self.kind: self.target}

    def free_way_m(self, robot: Pose) -> float:
        """How far it is to the object or the border, at least."""
        return way_to_contact_m(robot, self.target, self.footprint, self.rules)

    def advance(self, robot: Pose, elapsed_s: float) -> Step:
        """Tell where the robot is now.

        Args:
            robot: its pose, at most some centimetres from the last one: contacts in between are
                not seen.
            elapsed_s: simulated time since the last call.

        """
        if self.ended:
            raise RuntimeError("the run has ended: begin a new one")
        self._at_border = False
        self.object_s += elapsed_s
        if touches(robot, self.target, self.footprint, self.rules):
            return self.touched(robot)
        if at_border(robot, self.rules):
            return self.failed(Happening.BORDER)
        # Half a physics step: a sum of many small steps is not exact.
        if self.object_s >= self.rules.time_limit_s - 0.0025:
            return self.failed(Happening.TIME_OUT)
        return self._ran_into(self.touched_things(robot))

    def facts(self, moment: Moment) -> tuple[Any, ...]:
        """FACTS at a decision."""
        is_shown = moment.seen_s > moment.now_s - self.object_s - SLACK_S
        seen_left_rad = math.nan
        if is_shown:
            ahead_m, left_m = from_robot(moment.seen_from, self.target)
            seen_left_rad = math.atan2(left_m, ahead_m - moment.camera_ahead_m)
            if self.is_out_of_sight(moment.seen_from):
                seen_left_rad = math.pi
        aim = self.aim_from(moment.robot)
        return (
            len(self._touch_s),
            self.rules.time_limit_s - self.object_s,
            self._at_border,
            *from_robot(moment.robot, self.target),
            seen_left_rad,
            *from_robot(moment.robot, aim),
            *self.suspect(moment),
            self._wrong_things,
        )

    def touched_things(self, robot: Pose) -> frozenset[int]:
        """Which things that are not the object the robot touches."""
        return touched_things(robot, self.rules)

    def is_out_of_sight(self, eye: Pose) -> bool:
        """Whether something hides the object from there, in whatever direction it is."""
        return is_hidden(eye, self.target, self.rules.standing, OBJECT_HEIGHT_M)

    def aim_from(self, robot: Pose) -> Pose:
        """Where to drive first."""
        return aim_around(robot, self.target, self.rules.standing, self.rules.touch_radius_m)

    def suspect(self, moment: Moment) -> tuple[float, float]:
        """The nearest in view, in the robot's frame. What is near is noted as looked at: asking
        again about the same moment changes nothing.
        """
        nearest_m, found = math.inf, (math.inf, math.inf)
        for number, thing in enumerate(self.rules.standing):
            if not thing.is_alike or number in self._looked_at:
                continue
            place = Pose(thing.x_m, thing.y_m)
            ahead_m, left_m = from_robot(moment.seen_from, place)
            if abs(math.atan2(left_m, ahead_m - moment.camera_ahead_m)) > IN_VIEW_RAD:
                continue
            others = tuple(one for one in self.rules.standing if one is not thing)
            if is_hidden(moment.seen_from, place, others, thing.height_m):
                continue
            away_m = math.hypot(ahead_m, left_m)
            if away_m < TOLD_APART_M:
                self._looked_at.add(number)
            elif away_m < nearest_m:
                aim = aim_around(moment.robot, place, others, self.rules.touch_radius_m)
                nearest_m, found = away_m, from_robot(moment.robot, aim)
        return found

    def show_another(self, robot: Pose, reach_m: float) -> None:
        """Another object, up to so far from the middle on any side, which cameras see at once."""
        anywhere = replace(self.rules, spawn_half_angle_rad=math.pi, spawn_farthest_m=reach_m)
        self.next_object(robot, anywhere)
        self.object_s = DECISION_S

    def result(self) -> Mapping[str, Any]:
        """The run so far: a FetchResult."""
        result = FetchResult(
            touches=len(self._touch_s),
            seconds_per_touch=tuple(round(seconds, 3) for seconds in self._touch_s),
            border_contacts=self._failures[Happening.BORDER],
            time_outs=self._failures[Happening.TIME_OUT],
            wrong_things=self._wrong_things,
            completed=self._complete,
            score=round(self._score, 4),
        )
        return asdict(result)

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

    def touched(self, robot: Pose) -> Step:
        """Count it, and show the next one."""
        self._touch_s.append(self.object_s)
        score = touch_score(self.object_s, self.rules)
        if self._complete:
            score += COMPLETE_SCORE
        self._score += score
        self.ended = self._all_touched
        if not self.ended:
            self.next_object(robot)
        return Step(Happening.TOUCH, score, self.ended)

    def _ran_into(self, touching: frozenset[int]) -> Step:
        """Each counts once, until the robot has left it."""
        met = len(touching - self._touching)
        self._touching = touching
        self._wrong_things += met
        self._score += met * WRONG_SCORE
        return Step(Happening.WRONG, met * WRONG_SCORE) if met else Step()

    def failed(self, how: Happening) -> Step:
        """Count it; the run ends, or begins again with the next object."""
        self._failures[how] += 1
        self._at_border = how is Happening.BORDER
        self._score += FAILURE_SCORE
        self.ended = self.rules.ends_on_failure
        if not self.ended:
            self.next_object(ORIGIN)
        return Step(how, FAILURE_SCORE, self.ended, robot_to_origin=not self.ended)

    def next_object(self, robot: Pose, rules: FetchRules | None = None) -> None:
        """Put another one where there is room."""
        self.target = spawn(robot, rules or self.rules, self._rng)
        self.kind = draw_kind(self.rules, self._rng)
        self._looked_at: set[int] = set()
        self.object_s = 0.0


def from_robot(robot: Pose, target: Pose) -> tuple[float, float]:
    """How far ahead of the robot's axle and to its left something is, in metres."""
    dx, dy = target.x_m - robot.x_m, target.y_m - robot.y_m
    cos, sin = math.cos(robot.yaw_rad), math.sin(robot.yaw_rad)
    return cos * dx + sin * dy, cos * dy - sin * dx
