"""Fetch among 3 to 8 boxes, chairs, bags and bins."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from mbot_workstation.sim.scene.scene_look import Distractor
from mbot_workstation.tasks.episode import Setting
from mbot_workstation.tasks.fetch.lessons import FetchLesson
from mbot_workstation.tasks.fetch.task import TouchTask, rules_in
from mbot_workstation.tasks.obstacles.episode import ObstaclesEpisode, draw_obstacles


@dataclass(frozen=True, slots=True)
class ObstaclesLesson(FetchLesson):
    """One stage of the curriculum.

    Attributes:
        things: so many stand about, from the first to the second number.

    """

    things: tuple[int, int] = (3, 8)


class FetchAmongObstacles(TouchTask):
    """Touch ten objects, and nothing else."""

    name = "obstacles"
    lessons = (
        ObstaclesLesson("few", 2.0, objects=10, things=(1, 3)),
        ObstaclesLesson("3-to-8", 2.5, objects=10),
    )

    def begin(
        self, lesson: FetchLesson, setting: Setting, rng: np.random.Generator
    ) -> ObstaclesEpisode:
        """Start a run."""
        assert isinstance(lesson, ObstaclesLesson)
        rules = rules_in(lesson, setting)
        number = int(rng.integers(*lesson.things, endpoint=True))
        return ObstaclesEpisode(rules, rng, draw_obstacles(rng, number, rules.standing))

    def summary(self, result: Mapping[str, Any]) -> str:
        """For people."""
        return f"{super().summary(result)}; stuck {result['stuck']}"

    def pieces(self, episode: ObstaclesEpisode) -> tuple[Distractor, ...]:
        """What stands about."""
        return episode.obstacles.pieces


TASK = FetchAmongObstacles()
