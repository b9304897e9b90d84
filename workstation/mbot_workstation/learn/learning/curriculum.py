"""Where a training run stands in its lessons: a value that each finished episode moves on."""

from collections.abc import Sequence
from dataclasses import dataclass

from mbot_workstation.learn.worlds.lessons import PAPER_MARK, Lesson, PassMark, passed


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
