import json
import math
from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbot_workstation.learn.worlds.task_env import TaskEnv
from mbot_workstation.sim.pose import ORIGIN, Pose
from mbot_workstation.tasks.episode import NOTHING, Moment, Setting, Step
from mbot_workstation.tasks.stay import (
    DONE,
    FACTS,
    FORGOTTEN_S,
    LEFT,
    LOOKS_M,
    NEW_PLACE,
    NEW_PLACE_SCORE,
    PLACE_M,
    SEEN_M,
    TASK,
    TURNS_AT_M,
    WHEEL_M,
    StayLesson,
    StayRun,
    StaySight,
)

from .driven_task import drives
from .small_world import ROOMS

SETTING = Setting(contact_radius_m=0.09, border_m=2.9, footprints=())
ROUND = StayLesson("round", (1.0, 1.0), 0.0, 30.0)
"""A metre to every side, but for the corners of its pieces: those are 2 mm nearer."""

WIDE, LAST = (lesson for lesson in TASK.lessons if isinstance(lesson, StayLesson))
SIGHT = StaySight()
HERE, BESIDE = ORIGIN, Pose(PLACE_M, 0.0)


def stay(lesson: StayLesson = ROUND, seed: int = 0) -> StayRun:
    return TASK.begin(lesson, SETTING, np.random.default_rng(seed))


def happenings(steps: Iterable[Step]) -> list[str]:
    return [step.happening for step in steps]


def facts(run: StayRun, robot: Pose, seen_from: Pose | None = None) -> dict[str, Any]:
    told = run.facts(Moment(robot, 0.4, seen_from or robot, 0.35, camera_ahead_m=0.06))
    return dict(zip(FACTS.names or (), told, strict=True))


def test_a_wheel_on_the_tape_ends_it() -> None:
    run = stay()
    assert run.advance(Pose(0.0, 0.997 - WHEEL_M - 0.003), 0.4).happening != LEFT
    step = run.advance(Pose(0.0, 1.0 - WHEEL_M + 0.001), 0.4)
    assert (step.happening, step.score, step.ended, run.ended) == (LEFT, -1.0, True, True)


def test_who_is_beyond_the_tape_has_left() -> None:
    assert stay().advance(Pose(1.3, 0.0), 0.4).happening == LEFT


def test_who_stays_for_as_long_as_it_is_told_is_done() -> None:
    run = stay()
    steps = [run.advance(HERE, 0.5) for _ in range(60)]
    assert happenings(steps) == [NOTHING] * 59 + [DONE]
    assert (steps[-1].score, steps[-1].ended, run.ended) == (1.0, True, True)
    assert run.result() == {"seconds": 30, "score": 1.0}


def test_a_square_is_new_once_and_again_after_it_was_left_for_ten_seconds() -> None:
    run = stay()
    first = [run.advance(place, 0.5) for place in (HERE, BESIDE, BESIDE, HERE, BESIDE)]
    assert happenings(first) == [NOTHING, NEW_PLACE, NOTHING, NOTHING, NOTHING]
    assert [step.score for step in first] == [0, NEW_PLACE_SCORE, 0, 0, 0]
    away = [run.advance(HERE, 0.5) for _ in range(round(FORGOTTEN_S / 0.5))]
    assert set(happenings(away)) == {NOTHING}
    again = [run.advance(place, 0.5) for place in (BESIDE, HERE)]
    assert happenings(again) == [NEW_PLACE, NOTHING]
    soon = [run.advance(HERE, 0.5) for _ in range(round(0.9 * FORGOTTEN_S / 0.5))]
    assert set(happenings([*soon, run.advance(BESIDE, 0.4)])) == {NOTHING}, "not before"
    assert run.result()["score"] == pytest.approx(2 * NEW_PLACE_SCORE)
    assert not run.ended


@given(st.integers(0, 1000), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(-3.2, 3.2))
def test_nobody_leaves_within_the_way_that_is_free(
    seed: int, x_m: float, y_m: float, heading: float
) -> None:
    run = stay(LAST, seed)
    way_m = run.free_way_m(Pose(x_m, y_m)) - 1e-6
    if way_m <= 0 or not run.tape.encloses(x_m, y_m):
        return
    there = Pose(x_m + way_m * math.cos(heading), y_m + way_m * math.sin(heading))
    assert run.advance(there, 0.4).happening != LEFT


def test_facts_say_how_near_the_tape_is_now_and_how_near_it_was_in_the_picture() -> None:
    run = stay()
    run.advance(HERE, 2.5)
    told = facts(run, Pose(0.5, 0.0), Pose(0.0, 0.0))
    assert (told["seconds"], told["time_left_s"]) == (2, 27.5)
    for name, expected in (("to_tape_m", 0.5), ("way_ahead_m", 0.5), ("seen_way_m", 1.0)):
        assert told[name] == pytest.approx(expected, abs=0.003), name
    left = facts(run, Pose(0.0, 0.0), Pose(0.5, 0.0, -math.pi / 4))
    assert left["seen_left_way_m"] < left["seen_way_m"] < left["seen_right_way_m"] < LOOKS_M
    assert np.array(tuple(told.values()), FACTS).shape == ()


def test_facts_change_nothing_and_are_json_in_the_result() -> None:
    run, asked = stay(), stay()
    for number in range(20):
        robot = Pose(0.04 * number, 0.1, 0.1 * number)
        assert facts(asked, robot) == facts(asked, robot)
        assert asked.advance(robot, 0.4) == run.advance(robot, 0.4)
    assert json.loads(json.dumps(run.result())) == dict(asked.result())
    assert dict(run.places()) == {}


def test_its_guide_turns_left_before_the_tape_and_drives_straight_elsewhere() -> None:
    run = stay()
    straight, turn = facts(run, Pose(0.0, 0.0)), facts(run, Pose(1.01 - TURNS_AT_M, 0.0))
    assert (straight["aim_ahead_m"], straight["aim_left_m"]) == (1.0, 0.0)
    assert turn["aim_left_m"] > 0.9
    assert turn["aim_ahead_m"] < 0


def test_areas_are_as_large_as_the_lesson_says() -> None:
    for seed in range(30):
        away_m = np.hypot(*stay(WIDE, seed).tape.points.T)
        assert 1.1 * 0.85 < away_m.min() <= away_m.max() < 1.4 * 1.15


def test_pictures_are_taken_inside_and_tell_where_the_tape_is() -> None:
    run, rng = stay(LAST, 3), np.random.default_rng(0)
    poses = [SIGHT.scatter(run, rng) for _ in range(200)]
    for pose in poses:
        assert run.tape.encloses(pose.x_m, pose.y_m)
        assert run.free_way_m(pose) > 0
    told = np.array([tuple(facts(run, pose).values()) for pose in poses], FACTS)
    shown = SIGHT.shown(told)
    assert shown.shape == (200, 4)
    near = np.minimum.reduce(
        [told["seen_way_m"], told["seen_left_way_m"], told["seen_right_way_m"]]
    )
    np.testing.assert_array_equal(shown[:, 0] == 1, near < SEEN_M)
    assert 0 < shown[:, 0].mean() < 1
    leftmost = shown[:, 2] > shown[:, 3]
    np.testing.assert_array_equal(leftmost, told["seen_left_way_m"] < told["seen_right_way_m"])
    np.testing.assert_array_equal(SIGHT.mirrored(shown), shown[:, [0, 1, 3, 2]])


def test_its_tape_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    environment = TaskEnv("ideal", rooms=ROOMS, task="stay")
    taped, _ = environment.reset(seed=1)
    monkeypatch.setattr(type(TASK), "pieces", lambda *_: ())
    bare, _ = environment.reset(seed=1)
    environment.close()
    darker = bare.astype(int).sum(axis=2) - taped.astype(int).sum(axis=2) > 15
    assert 10 < darker.sum() < 1000
    assert darker[:25].sum() == 0, "on the floor"
    columns = darker.any(axis=0)
    assert columns[:8].any()
    assert columns[-8:].any(), "from side to side, though a tenth of a pixel high so far away"


def test_its_guide_earns_most_of_what_there_is_and_standing_does_not() -> None:
    guide, standing = drives("stay", "guide"), drives("stay", "standing")
    assert set(guide.counts) == {60}
    assert guide.reward > 0.8 * guide.largest
    assert standing.reward < 0.3 * guide.largest


def test_it_is_told_in_a_sentence_and_learned_from_its_last_lesson_with_the_guide() -> None:
    assert TASK.summary({"seconds": 12, "score": 1.25}) == "stayed inside for 12 s; score 1.25"
    assert TASK.course(guided=True, further=False) == ("60-s",)
    assert TASK.course(guided=False, further=False) == ("wide", "60-s")
    assert TASK.play(None, None, ends_on_failure=False) is LAST
    assert isinstance(TASK.sight, StaySight)
