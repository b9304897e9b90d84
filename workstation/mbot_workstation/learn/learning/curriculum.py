"""Where a training run stands in its lessons: a value that each finished episode moves on."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from mbot_workstation.tasks.lesson import Lesson


@dataclass(frozen=True, slots=True)
class PassMark:
    """When a lesson has been learned.

    Attributes:
        episodes: of the lesson's latest, so many count.
        share: of the lesson's largest reward that their mean must reach.

    """

    episodes: int
    share: float


PAPER_MARK = PassMark(episodes=420, share=0.9)
"""The paper: on with the next lesson when 420 episodes reached a mean reward of at least 0.9.

Read as a share of the lesson's largest reward (3, 5 or 21). A plain 0.9 points would let a robot
out of lesson 9 after one object of ten, while the paper spent 700,000 steps on it.
"""

GUIDED_MARK = PassMark(episodes=160, share=0.7)
"""Sooner, since a guide teaches the rest on any robot: within 160,000 decisions of lesson 10 (two
runs: docs/notebook/training.md, models/red-cube-run)."""


@dataclass(frozen=True, slots=True)
class CurriculumState:
    """A place in a list of lessons; JSON as it is, so a run can go on from it.

    Attributes:
        index: which lesson of the list.
        rewards: of its latest episodes, oldest first, at most as many as passing takes.
        episodes: finished in all lessons so far.

    """

    index: int = 0
    rewards: tuple[float, ...] = ()
    episodes: int = 0


def after_episode(
    state: CurriculumState,
    lessons: Sequence[Lesson],
    lesson_name: str,
    reward: float,
    mark: PassMark = PAPER_MARK,
) -> CurriculumState:
    """Where a run stands after an episode.

    Args:
        state: before.
        lessons: all lessons, in their order; the last one never ends.
        lesson_name: the episode's. When a lesson is passed, other robots are still in the middle
            of its episodes; those no longer count.
        reward: the episode's sum.
        mark: what passing a lesson takes.

    """
    episodes = state.episodes + 1
    if lesson_name != lessons[state.index].name:
        return CurriculumState(state.index, state.rewards, episodes)
    rewards = (*state.rewards, reward)[-mark.episodes :]
    if state.index + 1 < len(lessons) and passed(lessons[state.index], rewards, mark):
        return CurriculumState(state.index + 1, (), episodes)
    return CurriculumState(state.index, rewards, episodes)


def is_last(state: CurriculumState, lessons: Sequence[Lesson]) -> bool:
    """Whether the run has reached the last lesson."""
    return state.index + 1 == len(lessons)


def passed(lesson: Lesson, rewards: Sequence[float], mark: PassMark = PAPER_MARK) -> bool:
    """Whether a lesson has been learned.

    Args:
        lesson: which.
        rewards: of its episodes so far, oldest first.
        mark: what is asked for.

    """
    if len(rewards) < mark.episodes:
        return False
    recent = rewards[-mark.episodes :]
    return math.fsum(recent) / mark.episodes >= mark.share * lesson.largest_reward
