"""The rules of the paper's task: touch the object, again and again, in time, without the border."""

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np

from mbot_workstation.sim.pose import ORIGIN, Pose
from mbot_workstation.sim.scene.scene_look import Standing
from mbot_workstation.sim.scene.target_object import RED_CUBE, Footprint
from mbot_workstation.tasks.episode import DECISION_S
from mbot_workstation.tasks.fetch.obstacles import way_to_things_m

NEAR_M = 0.2, 0.5
"""How far from the robot an object appears that is to be near; it is touched at some 0.14 m."""

MOST_NEAR_TRIES, MOST_FREE_TRIES = 20, 200
"""Where things or the border leave no room right by the robot, it appears anywhere; where things
leave none at all, as before a robot in the first lessons, it appears among them.
"""

FROM_THINGS_M = 0.28
"""From a thing's edge to the object's middle, at least: the robot fits between."""

TIME_LIMIT_DECISIONS = 167
"""Derived from the paper: 19.8 of at most 21 points at 20 decisions an object of 0.4 s mean that
an object's time is up after about 167 decisions."""


@dataclass(frozen=True, slots=True)
class FetchRules:
    """How the task is set.

    Attributes:
        spawn_nearest_m, spawn_farthest_m: range of the object's distance from the origin; the
            farthest is what the paper's lessons raise, 2.5 m in the last.
        spawn_half_angle_rad: objects appear within this to either side of +x as seen from the
            origin, which is where the robot heads at first; pi is all around. Less only for runs
            of a single object.
        clearance_m: an object never appears nearer to the robot.
        near_share: of the objects, which appear as near as that or little farther, so that they
            are seen large and half out of the picture.
        time_limit_s: per object.
        objects: how many make a complete run; 0 is no end.
        border_m: the axle's centre touches the border at this |x| or |y|.
        touch_radius_m: the robot's body, a circle about the axle's centre.
        footprints: of the kinds of object; which one comes next is drawn.
        standing: things that are none, and in the way.
        ends_on_failure: whether border contact and time-out end the run, as in training; else
            the robot is put back to the origin and goes on.

    Raises:
        ValueError: no place fits the ranges.

    """

    spawn_nearest_m: float = 0.3
    spawn_farthest_m: float = 1.2
    spawn_half_angle_rad: float = math.pi
    clearance_m: float = 0.4
    near_share: float = 0.0
    time_limit_s: float = TIME_LIMIT_DECISIONS * DECISION_S
    objects: int = 10
    border_m: float = 2.9
    touch_radius_m: float = 0.090
    footprints: tuple[Footprint, ...] = (RED_CUBE.footprint,)
    standing: tuple[Standing, ...] = ()
    ends_on_failure: bool = True

    def __post_init__(self) -> None:
        # A robot in the origin needs a ring outside its clearance, and the object has to be
        # reachable before the border is.
        nearest = max(self.spawn_nearest_m, self.clearance_m) + 0.05
        farthest = self.border_m - self.touch_radius_m
        if not nearest <= self.spawn_farthest_m <= farthest:
            raise ValueError(
                f"objects up to {self.spawn_farthest_m:g} m away, expected {nearest:g} to "
                f"{farthest:g} m"
            )
        if not 0 < self.spawn_half_angle_rad <= math.pi:
            raise ValueError(f"half angle is {self.spawn_half_angle_rad} rad, expected up to pi")
        if self.spawn_half_angle_rad < math.pi and self.objects != 1:
            raise ValueError("a limited angle is for one object: a second may find no free place")


def touches(robot: Pose, target: Pose, footprint: Footprint, rules: FetchRules) -> bool:
    """Whether the robot's circle meets the object's footprint."""
    dx, dy = robot.x_m - target.x_m, robot.y_m - target.y_m
    cos, sin = math.cos(target.yaw_rad), math.sin(target.yaw_rad)
    beyond_x = max(abs(cos * dx + sin * dy) - footprint.half_ahead_m, 0.0)
    beyond_y = max(abs(cos * dy - sin * dx) - footprint.half_across_m, 0.0)
    return math.hypot(beyond_x, beyond_y) <= rules.touch_radius_m + footprint.radius_m


def at_border(robot: Pose, rules: FetchRules) -> bool:
    """Whether the robot touches the border."""
    return max(abs(robot.x_m), abs(robot.y_m)) >= rules.border_m


def touched_things(robot: Pose, rules: FetchRules) -> frozenset[int]:
    """Indices of the things that are not the object which the robot touches."""
    return frozenset(
        number
        for number, thing in enumerate(rules.standing)
        if way_to_things_m(robot, (thing,), rules.touch_radius_m) <= 0
    )


def way_to_contact_m(robot: Pose, target: Pose, footprint: Footprint, rules: FetchRules) -> float:
    """How far the robot can drive at least, whatever the way, before it touches anything."""
    distance = math.hypot(robot.x_m - target.x_m, robot.y_m - target.y_m)
    to_object = distance - footprint.reach_m - rules.touch_radius_m
    to_border = rules.border_m - max(abs(robot.x_m), abs(robot.y_m))
    to_things = way_to_things_m(robot, rules.standing, rules.touch_radius_m)
    return max(0.0, min(to_object, to_border, to_things))


def spawn(robot: Pose, rules: FetchRules, rng: np.random.Generator) -> Pose:
    """A place for the next object: distance and angle even, clear of robot and things, any yaw."""
    near = rules.near_share > 0 and rng.random() < rules.near_share
    clearance_m = NEAR_M[0] if near else rules.clearance_m
    for tries in itertools.count():
        by_robot = near and tries < MOST_NEAR_TRIES
        around = robot if by_robot else ORIGIN
        reach_m = NEAR_M if by_robot else (rules.spawn_nearest_m, rules.spawn_farthest_m)
        distance = rng.uniform(*reach_m)
        angle = rng.uniform(-rules.spawn_half_angle_rad, rules.spawn_half_angle_rad)
        place = Pose(
            around.x_m + distance * math.cos(angle),
            around.y_m + distance * math.sin(angle),
            0.0,
        )
        inside = max(abs(place.x_m), abs(place.y_m)) <= rules.spawn_farthest_m
        clear = math.hypot(place.x_m - robot.x_m, place.y_m - robot.y_m) >= clearance_m
        away_m = way_to_things_m(place, rules.standing, 0.0)
        if inside and clear and (away_m >= FROM_THINGS_M or tries >= MOST_FREE_TRIES):
            return replace(place, yaw_rad=rng.uniform(-math.pi, math.pi))
    raise AssertionError("counting never ends")


def draw_kind(rules: FetchRules, rng: np.random.Generator) -> int:
    """Which kind of object comes next, each as likely."""
    kinds = len(rules.footprints)
    return int(rng.integers(kinds)) if kinds > 1 else 0


def touch_score(seconds: float, rules: FetchRules) -> float:
    """1 for the touch and the fraction of time that was left."""
    return 1.0 + max(0.0, 1.0 - seconds / rules.time_limit_s)


WRONG_SCORE = -0.5
"""For running into a thing that is not the object; assumed: the time of 80 decisions."""

COMPLETE_SCORE = 1.0
"""For a run in which every object was touched without a failure: ten objects give at most
10 x (1 + 1) + 1 = 21."""

FAILURE_SCORE = -1.0
"""For border contact or a time-out; the paper gives no figure."""
