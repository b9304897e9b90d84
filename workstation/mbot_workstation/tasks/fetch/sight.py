"""Pictures of the object and of what is not it, taken from anywhere in the arena."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbot_workstation.sim.pose import Pose
from mbot_workstation.tasks.fetch.episode import IN_VIEW_RAD, FetchEpisode

MOST_M = 2.4
"""A robot stands at this |x| and |y| at most."""

REACH_M = 2.5
"""Objects are up to so far from the middle, as in the last lesson: who is to learn the first one by
driving has seen them all."""

ANYWHERE, FROM_NEARBY = 0.3, 0.5
"""How many pictures look in any direction, and how many of the others are taken from within 1.2 m
of what they look at. Assumed."""


class FetchSight:
    """See `Sight`."""

    def scatter(self, episode: FetchEpisode, rng: np.random.Generator) -> Pose:
        """The object elsewhere, and a robot that mostly looks at it or at another thing."""
        robot = Pose(*rng.uniform(-MOST_M, MOST_M, 2).tolist())
        episode.show_another(robot, REACH_M)
        if rng.random() < ANYWHERE:
            return replace(robot, yaw_rad=rng.uniform(-math.pi, math.pi))
        things = (Pose(one.x_m, one.y_m) for one in episode.rules.standing)
        places = [episode.target, *things]
        seen = places[0 if rng.random() < 0.5 else int(rng.integers(len(places)))]
        if rng.random() < FROM_NEARBY:
            angle, away_m = rng.uniform(-math.pi, math.pi), rng.uniform(0.2, 1.2)
            robot = Pose(seen.x_m + away_m * math.cos(angle), seen.y_m + away_m * math.sin(angle))
        heading = math.atan2(seen.y_m - robot.y_m, seen.x_m - robot.x_m)
        return replace(robot, yaw_rad=heading + rng.uniform(-1.1, 1.1) * IN_VIEW_RAD)

    def shown(self, facts: "np.ndarray[Any, np.dtype[np.void]]") -> NDArray[np.float32]:
        """Whether the object is in view, in which direction, and how near it is."""
        is_shown = np.abs(facts["seen_left_rad"]) <= IN_VIEW_RAD
        away_m = np.hypot(facts["target_ahead_m"], facts["target_left_m"])
        left = facts["seen_left_rad"] / IN_VIEW_RAD
        near = 0.5 / np.maximum(away_m, 0.2)
        return np.stack([is_shown, left, near], axis=1).astype(np.float32)

    def mirrored(self, shown: NDArray[np.float32]) -> NDArray[np.float32]:
        """In the other direction."""
        return shown * np.array([1, -1, 1], np.float32)
