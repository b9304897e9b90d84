import msgspec
from hypothesis import given
from hypothesis import strategies as st

from mbot_workstation.learn.learning.curriculum import (
    PAPER_MARK,
    CurriculumState,
    PassMark,
    after_episode,
    is_last,
)
from mbot_workstation.tasks.fetch.lessons import LESSONS
from mbot_workstation.tasks.lesson import Lesson

FEW = LESSONS[:3]

Episodes = list[tuple[str, float]]

# Blocks of like episodes: single random ones would hardly ever pass a lesson.
block = st.tuples(
    st.sampled_from([lesson.name for lesson in FEW]),
    st.floats(-1, 3),
    st.integers(1, 2 * PAPER_MARK.episodes),
)
histories = st.lists(block, max_size=6).map(
    lambda blocks: [(name, reward) for name, reward, count in blocks for _ in range(count)]
)


def after(state: CurriculumState, episodes: Episodes) -> CurriculumState:
    for name, reward in episodes:
        state = after_episode(state, FEW, name, reward)
    return state


def enough(lesson: Lesson) -> float:
    return PAPER_MARK.share * lesson.largest_reward


def test_a_lesson_ends_with_its_420th_good_episode() -> None:
    state = after(CurriculumState(), [("1", enough(FEW[0]) + 0.01)] * (PAPER_MARK.episodes - 1))
    assert state.index == 0
    state = after_episode(state, FEW, "1", 3.0)
    assert (state.index, state.rewards) == (1, ())


def test_bad_episodes_are_forgotten_in_time() -> None:
    state = after(CurriculumState(), [("1", -1.0)] * 1000)
    assert state.index == 0
    assert after(state, [("1", 3.0)] * PAPER_MARK.episodes).index == 1


def test_a_lower_mark_is_reached_sooner() -> None:
    mark = PassMark(episodes=3, share=0.5)
    state = CurriculumState()
    for reward, index in ((3.0, 0), (-1.0, 0), (2.4, 0), (1.4, 0), (0.8, 1)):
        state = after_episode(state, FEW, FEW[0].name, reward, mark)
        assert state.index == index
        assert len(state.rewards) <= mark.episodes


@given(histories)
def test_each_step_on_is_earned(episodes: Episodes) -> None:
    state = CurriculumState()
    since: list[float] = []
    for name, reward in episodes:
        before, state = state, after_episode(state, FEW, name, reward)
        if name == FEW[before.index].name:
            since.append(reward)
        if state.index != before.index:
            assert state.index == before.index + 1
            assert len(since) >= PAPER_MARK.episodes
            recent = since[-PAPER_MARK.episodes :]
            assert sum(recent) / len(recent) >= enough(FEW[before.index]) - 1e-9
            since = []
        assert len(state.rewards) <= PAPER_MARK.episodes
    assert state.episodes == len(episodes)


@given(histories, st.floats(-1, 3))
def test_episodes_of_other_lessons_change_nothing(episodes: Episodes, reward: float) -> None:
    state = after(CurriculumState(), episodes)
    other = FEW[state.index - 1].name
    changed = after_episode(state, FEW, other, reward)
    assert (changed.index, changed.rewards) == (state.index, state.rewards)


@given(histories, histories)
def test_a_run_goes_on_from_json_as_if_nothing_had_happened(
    first: Episodes, then: Episodes
) -> None:
    state = after(CurriculumState(), first)
    restored = msgspec.json.decode(msgspec.json.encode(state), type=CurriculumState)
    assert restored == state
    assert after(restored, then) == after(CurriculumState(), first + then)


@given(histories)
def test_the_last_lesson_never_ends(episodes: Episodes) -> None:
    last = CurriculumState(index=len(FEW) - 1)
    assert is_last(after(last, [(FEW[-1].name, 3.0)] * PAPER_MARK.episodes + episodes), FEW)
