"""The paper's task: find the object, touch it, find the next one."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.effects.effects import EffectRanges
from mbot_workstation.tasks.episode import NOTHING, Guide, Setting
from mbot_workstation.tasks.fetch.episode import FACTS, FetchEpisode, Happening
from mbot_workstation.tasks.fetch.guide import FetchGuide
from mbot_workstation.tasks.fetch.lessons import (
    BLUR_LESSON,
    LESSONS,
    ROUGH_LESSON,
    FetchLesson,
)
from mbot_workstation.tasks.fetch.oracle import Oracle, middle
from mbot_workstation.tasks.fetch.rules import FetchRules
from mbot_workstation.tasks.fetch.sight import FetchSight
from mbot_workstation.tasks.sight import Sight
from mbot_workstation.tasks.task import Expert, Reference, Task

PAPER = Reference(reward=19.8, decisions=20.0)
"""The paper's plateau in lesson 10."""


class TouchTask(Task):
    """Touch objects, one after the other, each within its time, and stay off the border.

    Derive from it, and name the task and its lessons.
    """

    counted, counted_one, counted_done = "touches", "object", "touched"
    happenings = (NOTHING, *Happening)
    facts = FACTS
    mistakes = ("wrong_things",)
    sight: Sight | None = FetchSight()
    critic: Mapping[str, float] = {
        "target_ahead_m": 0.5,
        "target_left_m": 0.5,
        "seen_left_rad": 0.3,
        "time_left_s": 0.02,
        "touches": 0.1,
    }

    def begin(
        self, lesson: FetchLesson, setting: Setting, rng: np.random.Generator
    ) -> FetchEpisode:
        """Start a run of this lesson."""
        return FetchEpisode(rules_in(lesson, setting), rng)

    def play(
        self, reach_m: float | None, goal: int | None, *, ends_on_failure: bool
    ) -> FetchLesson:
        """The last lesson with so many objects, or without end."""
        last = self.lessons[-1]
        assert isinstance(last, FetchLesson)
        return replace(
            last,
            name="play",
            spawn_farthest_m=last.spawn_farthest_m if reach_m is None else reach_m,
            objects=goal or 0,
            ends_on_failure=ends_on_failure,
        )

    def guide(
        self, robots: int, ranges: EffectRanges, robot: RobotParameters, remembers: int
    ) -> Guide:
        """Who turns until the object comes into view, and drives there as the oracle would."""
        return FetchGuide(robots, ranges, robot, remembers)

    def expert(self, robots: int, ranges: EffectRanges, robot: RobotParameters) -> Expert:
        """Who is told where the object is."""
        oracle = Oracle(robots, middle(ranges), robot)
        return lambda infos: oracle.act(targets_in(infos))

    def summary(self, result: Mapping[str, Any]) -> str:
        """For people."""
        seconds = result["seconds_per_touch"]
        mean = f", {sum(seconds) / len(seconds):.1f} s each" if seconds else ""
        wrong = result["wrong_things"]
        return (
            f"touched {result['touches']}{mean}; border {result['border_contacts']}, time-outs "
            f"{result['time_outs']}{f', wrong things {wrong}' if wrong else ''}; score "
            f"{result['score']:.2f}"
        )


class Fetch(TouchTask):
    """Ten objects."""

    name = "fetch"
    lessons = (*LESSONS, BLUR_LESSON, ROUGH_LESSON)

    def course(self, *, guided: bool, further: bool) -> tuple[str, ...]:
        """All ten of the paper's; with a guide its last one, then robots of all kinds."""
        if further:
            return (ROUGH_LESSON.name,)
        if guided:
            return (LESSONS[-1].name, ROUGH_LESSON.name)
        return tuple(lesson.name for lesson in LESSONS)

    def play(
        self, reach_m: float | None, goal: int | None, *, ends_on_failure: bool
    ) -> FetchLesson:
        """Objects up to so far from the middle, 1.2 m; so many of them, or without end."""
        usual = FetchRules()
        return FetchLesson(
            "play",
            usual.spawn_farthest_m if reach_m is None else reach_m,
            objects=goal or 0,
            ends_on_failure=ends_on_failure,
        )

    def reference(self, lesson: FetchLesson) -> Reference | None:
        """The paper's, for its ten objects."""
        return PAPER if lesson.objects == 10 else None


def rules_in(lesson: FetchLesson, setting: Setting) -> FetchRules:
    """The lesson's rules in this arena; raises ValueError if no object fits in there."""
    return replace(
        lesson.rules,
        touch_radius_m=setting.contact_radius_m,
        footprints=setting.footprints,
        border_m=setting.border_m,
        standing=setting.standing,
    )


def targets_in(infos: Sequence[Mapping[str, Any]]) -> "np.ndarray[Any, np.dtype[np.float64]]":
    """Where each robot has to drive to its object, shape (n, 2); NaN where an info does not say."""
    unknown = float("nan")
    return np.array([(i.get("aim_ahead_m", unknown), i.get("aim_left_m", unknown)) for i in infos])


TASK = Fetch()
