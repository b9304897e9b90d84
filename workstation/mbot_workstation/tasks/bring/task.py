"""Take the red cube to a green mat, ten times."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbot_workstation.sim.pose import Pose
from mbot_workstation.sim.scene.scene_look import Distractor
from mbot_workstation.tasks.bring.episode import BROUGHT, FACTS, TAKEN, BringEpisode
from mbot_workstation.tasks.episode import NOTHING, Setting
from mbot_workstation.tasks.fetch.episode import IN_VIEW_RAD, Happening
from mbot_workstation.tasks.fetch.lessons import FetchLesson
from mbot_workstation.tasks.fetch.sight import FetchSight
from mbot_workstation.tasks.fetch.task import TouchTask, rules_in

LOOKS_AT_MAT = 0.4
"""Share of pictures to learn from that are taken towards it. Assumed."""


@dataclass(frozen=True, slots=True)
class BringLesson(FetchLesson):
    """One stage of the curriculum."""

    @property
    def largest_reward(self) -> float:
        """2 for each taken at once and 2 for each brought at once, 1 for the complete run."""
        return 4.0 * self.objects + 1.0


class BringSight:
    """See `Sight`: fetch's, and the mat."""

    _fetch = FetchSight()

    def scatter(self, episode: BringEpisode, rng: np.random.Generator) -> Pose:
        """Often towards the mat."""
        pose = self._fetch.scatter(episode, rng)
        if rng.random() >= LOOKS_AT_MAT:
            return pose
        angle, away_m = rng.uniform(-np.pi, np.pi), rng.uniform(0.15, 1.3)
        x_m = episode.mat.x_m + away_m * float(np.cos(angle))
        y_m = episode.mat.y_m + away_m * float(np.sin(angle))
        return replace(pose, x_m=x_m, y_m=y_m, yaw_rad=angle + np.pi + rng.uniform(-0.5, 0.5))

    def shown(self, facts: "np.ndarray[Any, np.dtype[np.void]]") -> NDArray[np.float32]:
        """Object or mat; whether each, and where."""
        cube = self._fetch.shown(facts)
        mat_left = facts["mat_left_rad"]
        mat = np.abs(mat_left) <= IN_VIEW_RAD
        parts = [
            np.maximum(cube[:, 0], mat),
            *(cube[:, 0], cube[:, 0] * np.nan_to_num(cube[:, 1]), cube[:, 0] * cube[:, 2]),
            *(mat, np.where(mat, mat_left / IN_VIEW_RAD, 0.0)),
        ]
        return np.stack(parts, axis=1).astype(np.float32)

    def mirrored(self, shown: NDArray[np.float32]) -> NDArray[np.float32]:
        """In the other direction."""
        return shown * np.array([1, 1, -1, 1, 1, -1], np.float32)


class Bring(TouchTask):
    """Touch the object, which is then carried, and drive onto the mat."""

    name = "bring"
    counted, counted_one, counted_done = "brought", "object", "brought"
    happenings = (NOTHING, *Happening, TAKEN, BROUGHT)
    facts = FACTS
    sight = BringSight()
    critic: Mapping[str, float] = {**TouchTask.critic, "carries": 1.0, "mat_left_rad": 0.3}
    lessons = (
        BringLesson("one", 1.2, objects=1),
        BringLesson("ten", 1.5, objects=10),
    )

    def begin(
        self, lesson: FetchLesson, setting: Setting, rng: np.random.Generator
    ) -> BringEpisode:
        """Start a run."""
        return BringEpisode(rules_in(lesson, setting), rng)

    def pieces(self, episode: BringEpisode) -> tuple[Distractor, ...]:
        """The mat."""
        return (episode.mat_piece(),)

    def summary(self, result: Mapping[str, Any]) -> str:
        """For people."""
        return (
            f"took {result['taken']}, brought {result['brought']}; border "
            f"{result['border_contacts']}, time-outs {result['time_outs']}; score "
            f"{result['score']:.2f}"
        )


TASK = Bring()
