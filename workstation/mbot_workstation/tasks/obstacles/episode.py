"""A run among obstacles: they can't be driven through, touching one costs, pushing one ends it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mbot_workstation.sim.effects.scene_looks import unlike_an_object
from mbot_workstation.sim.pose import Pose
from mbot_workstation.sim.scene.scene_look import Distractor, Standing
from mbot_workstation.sim.scene.target_object import RED_CUBE
from mbot_workstation.sim.scene.things import LARGE, Thing
from mbot_workstation.tasks.episode import Moment, Step
from mbot_workstation.tasks.fetch.episode import (
    IN_VIEW_RAD,
    FetchEpisode,
    Happening,
    from_robot,
)
from mbot_workstation.tasks.fetch.rules import FetchRules
from mbot_workstation.tasks.floor.floor_map import FloorMap, Ways
from mbot_workstation.tasks.floor.search import Search
from mbot_workstation.tasks.floor.solids import Solids, Wall

HARDLY_M = 1e-4
"""Who is nearer by less stands, and pushes nothing."""

CHAIR = "chair"
KINDS = ("carton", CHAIR, "bag", "bin")

GAP_M, FROM_START_M, REACH_M = 0.45, 0.55, 2.3
"""Between two of them, so that a robot fits through; from the start; to every side."""

MOST_TRIES = 400

STUCK_S = 3.0
"""So long it may push."""

PRESSED_M = 0.001
"""Who is pushed back keeps touching by so much, or would touch again with every step."""

FROM_BORDER_M = 0.15
"""No way leads nearer to it."""

FROM_WALLS_M = 0.2
"""An object's middle; a robot's front comes within 0.09 m."""

HIDES_M = 0.02
"""So near to the straight view a wall hides the middle of an object."""

LEG_HEIGHT_M = 0.3
"""Of a chair's legs, at least."""


@dataclass(frozen=True, slots=True)
class Obstacles:
    """What stands about.

    Attributes:
        pieces: to be drawn.
        standing: to be met; a chair is its legs.
        walls: likewise, and one can't see through them.

    """

    pieces: tuple[Distractor, ...]
    standing: tuple[Standing, ...] = ()
    walls: tuple[Wall, ...] = ()


def draw_obstacles(
    rng: np.random.Generator, number: int, standing_already: tuple[Standing, ...] = ()
) -> Obstacles:
    """So many things, all around the start, apart from each other and from what stands already;
    fewer where there is no room.
    """
    pieces: list[Distractor] = []
    standing: list[Standing] = []
    placed: list[tuple[float, float, float]] = [
        (0.0, 0.0, FROM_START_M - GAP_M),
        *((one.x_m, one.y_m, one.radius_m) for one in standing_already),
    ]
    most = len(placed) + number
    for _ in range(MOST_TRIES):
        if len(placed) == most:
            break
        name = str(rng.choice(KINDS))
        thing = LARGE[name](rng, unlike_an_object(rng, (RED_CUBE,)))
        x, y = rng.uniform(-REACH_M, REACH_M, 2).tolist()
        gaps_m = (math.hypot(x - ox, y - oy) - thing.radius_m - r for ox, oy, r in placed)
        if min(gaps_m) < GAP_M:
            continue
        placed.append((x, y, thing.radius_m))
        parts = thing.at(x, y, rng.uniform(-math.pi, math.pi))
        pieces += parts
        standing += _met(name, thing, parts, x, y)
    return Obstacles(tuple(pieces), tuple(standing))


def _met(
    name: str, thing: Thing, parts: list[Distractor], x_m: float, y_m: float
) -> list[Standing]:
    """What of a thing a robot runs into: of a chair its legs."""
    if name != CHAIR:
        return [Standing(name, x_m, y_m, thing.radius_m, thing.height_m)]
    return [
        Standing("leg", leg.centre_m[0], leg.centre_m[1], leg.half_size_m[0], LEG_HEIGHT_M)
        for leg in parts
        if leg.shape == "post"
    ]


class ObstaclesEpisode(FetchEpisode):
    """One run.

    Attributes:
        obstacles: what stands about.
        floor: where it can drive.

    """

    def __init__(self, rules: FetchRules, rng: np.random.Generator, obstacles: Obstacles) -> None:
        self.obstacles = obstacles
        things = (*rules.standing, *obstacles.standing)
        self._solids, self._things = Solids.of(things, obstacles.walls), len(things)
        floor_m = rules.border_m - FROM_BORDER_M
        self.floor = FloorMap(floor_m, self._solids, rules.touch_radius_m)
        self._ways: dict[Pose, Ways] = {}
        self._search = Search()
        self._pushing_s = 0.0
        super().__init__(replace(rules, standing=things), rng)

    def advance(self, robot: Pose, elapsed_s: float) -> Step:
        """As without them; what it touches stays where it is."""
        step = super().advance(robot, elapsed_s)
        if step.ended or step.robot_to_origin:
            self._pushing_s = 0.0
            return step
        radius_m = self.rules.touch_radius_m - PRESSED_M
        push = self._solids.out_of_m(robot, radius_m, HARDLY_M)
        self._search.advance(robot, self.floor)
        self._pushing_s = self._pushing_s + elapsed_s if push != (0.0, 0.0) else 0.0
        if self._pushing_s >= STUCK_S and step.happening != Happening.TOUCH:
            self._pushing_s = 0.0
            stuck = self.failed(Happening.STUCK)
            return replace(stuck, score=stuck.score + step.score)
        return replace(step, pushed_m=push)

    def touched_things(self, robot: Pose) -> frozenset[int]:
        """With the walls, which count on after the things."""
        gaps_m = self._solids.gaps_m(np.array([robot.x_m, robot.y_m]))
        return frozenset(np.flatnonzero(gaps_m <= self.rules.touch_radius_m).tolist())

    def free_way_m(self, robot: Pose) -> float:
        """How far it is to anything, at least."""
        if not self.obstacles.walls:
            return super().free_way_m(robot)
        gap_m = float(self._solids.gaps_m(np.array([robot.x_m, robot.y_m])).min())
        return max(0.0, min(super().free_way_m(robot), gap_m - self.rules.touch_radius_m))

    def is_out_of_sight(self, eye: Pose) -> bool:
        """Behind a thing or a wall."""
        if super().is_out_of_sight(eye):
            return True
        target = np.array([[self.target.x_m, self.target.y_m]])
        walls = self._solids.beside_m(eye, target)[0, self._things :]
        return bool((walls < HIDES_M).any())

    def aim_from(self, robot: Pose) -> Pose:
        """Where the shortest way turns first."""
        return self._way_to(self.target, robot)

    def suspect(self, moment: Moment) -> tuple[float, float]:
        """What looks like the object from afar; else from where it may be seen, after a turn in
        vain.
        """
        found = super().suspect(moment)
        place = self._search.goes_to
        if math.isfinite(found[0]) or place is None:
            return found
        return from_robot(moment.robot, self._way_to(place, moment.robot))

    def facts(self, moment: Moment) -> tuple[Any, ...]:
        """FACTS at a decision."""
        ahead_m, left_m = from_robot(moment.seen_from, self.target)
        seen_rad = abs(math.atan2(left_m, ahead_m - moment.camera_ahead_m))
        if seen_rad <= IN_VIEW_RAD and not self.is_out_of_sight(moment.seen_from):
            self._search.begin()
        return super().facts(moment)

    def _way_to(self, place: Pose, robot: Pose) -> Pose:
        """The furthest place of the way there that can be driven to in a straight line."""
        if self.floor.is_clear(robot, np.array([[place.x_m, place.y_m]]))[0]:
            return place
        if place not in self._ways:  # to the object, and to where it may be seen: both are asked
            self._ways[place] = self.floor.ways_to(place)
        return self._ways[place].next_from(robot)

    def next_object(self, robot: Pose, rules: FetchRules | None = None) -> None:
        """Another one, which is looked for; not in a wall."""
        for _ in range(MOST_TRIES):
            super().next_object(robot, rules)
            gaps_m = self._solids.gaps_m(np.array([self.target.x_m, self.target.y_m]))
            if (gaps_m[self._things :] >= FROM_WALLS_M).all():
                break
        self._search.begin()
        self._ways.clear()

    def result(self) -> Mapping[str, Any]:
        """With how often it got stuck."""
        return {**super().result(), "stuck": self._failures[Happening.STUCK]}
