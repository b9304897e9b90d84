"""Find what is not in view: objects in the rooms of a flat, one after the other."""

from dataclasses import dataclass, replace

import numpy as np

from mbot_workstation.tasks.episode import Setting
from mbot_workstation.tasks.fetch.lessons import FetchLesson
from mbot_workstation.tasks.fetch.task import rules_in
from mbot_workstation.tasks.floor.flat import draw_flat
from mbot_workstation.tasks.obstacles.episode import Obstacles, ObstaclesEpisode
from mbot_workstation.tasks.obstacles.task import FetchAmongObstacles


@dataclass(frozen=True, slots=True)
class HiddenLesson(FetchLesson):
    """One stage of the curriculum.

    Attributes:
        cuts: by so many walls, from the first to the second number, a flat is cut into rooms.

    """

    cuts: tuple[int, int] = (1, 3)


FLAT = HiddenLesson("flat", 2.5, objects=10, time_limit_s=100.0)


class FindHidden(FetchAmongObstacles):
    """Touch ten objects, wherever in a flat they are."""

    name = "hidden"
    lessons = (replace(FLAT, name="two-rooms", spawn_farthest_m=2.3, cuts=(1, 1)), FLAT)

    def begin(
        self, lesson: FetchLesson, setting: Setting, rng: np.random.Generator
    ) -> ObstaclesEpisode:
        """Start a run in a flat of its own."""
        assert isinstance(lesson, HiddenLesson)
        flat = draw_flat(rng, int(rng.integers(*lesson.cuts, endpoint=True)))
        obstacles = Obstacles(flat.pieces(rng), walls=flat.walls)
        return ObstaclesEpisode(rules_in(lesson, setting), rng, obstacles)


TASK = FindHidden()
