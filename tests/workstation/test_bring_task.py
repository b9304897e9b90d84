import json
import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbot_workstation.learn.worlds.task_env import TaskEnv
from mbot_workstation.sim.pose import ORIGIN, Pose
from mbot_workstation.sim.scene.target_object import RED_CUBE
from mbot_workstation.tasks.bring.episode import (
    BROUGHT,
    MAT_FROM_START_M,
    MAT_HALF_M,
    MAT_SEEN_M,
    OBJECT_FROM_MAT_M,
    TAKEN,
    BringEpisode,
)
from mbot_workstation.tasks.bring.task import TASK, BringLesson, BringSight
from mbot_workstation.tasks.episode import NOTHING, Moment, Setting
from mbot_workstation.tasks.fetch.episode import IN_VIEW_RAD, Happening
from mbot_workstation.tasks.fetch.rules import FAILURE_SCORE, TIME_LIMIT_DECISIONS

from .driven_task import drives, world_of
from .small_world import ROOMS

SETTING = Setting(0.09, 2.9, (RED_CUBE.footprint,))
ONE, TEN = (lesson for lesson in TASK.lessons if isinstance(lesson, BringLesson))
SIGHT = BringSight()
PLAY = TASK.play(None, None, ends_on_failure=False)
LIMIT_S = 0.4 * TIME_LIMIT_DECISIONS


def bring(ends: bool = True, seed: int = 0) -> BringEpisode:
    lesson = TEN if ends else PLAY
    return TASK.begin(lesson, SETTING, np.random.default_rng(seed))


def carrying(ends: bool = True, seed: int = 0) -> BringEpisode:
    run = bring(ends, seed)
    assert run.advance(run.target, 0.0).happening == TAKEN
    return run


def by_mat(run: BringEpisode, ahead_m: float, left_m: float = 0.0) -> Pose:
    """A place in the mat's own frame."""
    cos, sin = math.cos(run.mat.yaw_rad), math.sin(run.mat.yaw_rad)
    return Pose(
        run.mat.x_m + cos * ahead_m - sin * left_m, run.mat.y_m + sin * ahead_m + cos * left_m
    )


def from_mat_m(run: BringEpisode, place: Pose) -> float:
    return math.hypot(place.x_m - run.mat.x_m, place.y_m - run.mat.y_m)


def facts(run: BringEpisode, robot: Pose, seen_s: float = 0.35) -> Mapping[str, Any]:
    told = run.facts(Moment(robot, 0.4, robot, seen_s, camera_ahead_m=0.06))
    return dict(zip(TASK.facts.names or (), told, strict=True))


def test_a_perfect_run_takes_and_brings_ten_and_gives_the_largest_reward() -> None:
    run, total = bring(), 0.0
    for number in range(10):
        taken = run.advance(run.target, 0.0)
        assert (taken.happening, taken.score, taken.ended) == (TAKEN, 2.0, False)
        brought = run.advance(run.mat, 0.0)
        assert (brought.happening, brought.ended) == (BROUGHT, number == 9)
        total += taken.score + brought.score
    result = run.result()
    assert total == result["score"] == TEN.largest_reward == 41
    assert (result["taken"], result["brought"], result["completed"]) == (10, 10, True)
    assert json.loads(json.dumps(result))["brought"] == 10


def test_what_was_taken_is_gone_until_it_was_brought() -> None:
    run = bring()
    first = run.target
    assert dict(run.places()) == {0: first}
    run.advance(first, 0.0)
    assert dict(run.places()) == {}
    assert run.advance(first, 0.1).happening == NOTHING, "it is not there any more"
    run.advance(run.mat, 0.0)
    assert dict(run.places()) == {0: run.target}
    assert run.target != first


def test_to_take_and_to_bring_have_their_own_time() -> None:
    run = bring()
    run.advance(ORIGIN, LIMIT_S - 1)
    assert run.advance(run.target, 0.5).score == pytest.approx(1 + 0.5 / LIMIT_S)
    assert run.advance(ORIGIN, LIMIT_S / 2).happening == NOTHING
    assert run.advance(run.mat, 0.0).score == pytest.approx(1.5)


@given(st.integers(0, 50), st.floats(-0.2, 0.2), st.floats(-0.2, 0.2))
def test_it_is_brought_with_the_axle_over_the_mat_and_not_beside_it(
    seed: int, ahead_m: float, left_m: float
) -> None:
    run = carrying(seed=seed)
    step = run.advance(by_mat(run, ahead_m, left_m), 0.1)
    far = max(abs(ahead_m), abs(left_m))
    if far > MAT_HALF_M + 1e-6:
        assert step.happening == NOTHING
    elif math.hypot(ahead_m, left_m) < MAT_HALF_M - 1e-6:
        assert step.happening == BROUGHT


@given(st.integers(0, 50), st.floats(0.0, 1.5), st.floats(-3.1, 3.1), st.floats(-3.1, 3.1))
def test_nothing_happens_within_the_way_that_is_free(
    seed: int, away_m: float, angle: float, heading: float
) -> None:
    run = carrying(seed=seed)
    robot = by_mat(run, away_m * math.cos(angle), away_m * math.sin(angle))
    way_m = run.free_way_m(robot) - 1e-6
    if way_m > 0:
        there = Pose(robot.x_m + way_m * math.cos(heading), robot.y_m + way_m * math.sin(heading))
        assert run.advance(there, 0.1).happening == NOTHING


def test_without_an_object_the_mat_is_floor() -> None:
    run = bring()
    assert run.advance(run.mat, 0.1).happening == NOTHING
    assert run.result()["brought"] == 0


def test_objects_never_appear_on_the_mat_and_mats_are_near_the_start() -> None:
    for seed in range(40):
        run = bring(ends=False, seed=seed)
        near_m, far_m = MAT_FROM_START_M
        assert near_m <= math.hypot(run.mat.x_m, run.mat.y_m) <= far_m
        for _ in range(10):
            assert from_mat_m(run, run.target) >= OBJECT_FROM_MAT_M
            run.advance(run.target, 0.0)
            run.advance(run.mat, 0.0)


def test_out_of_time_while_it_carries_the_run_ends() -> None:
    run = carrying()
    step = run.advance(ORIGIN, LIMIT_S)
    assert (step.happening, step.score, step.ended) == (Happening.TIME_OUT, FAILURE_SCORE, True)
    result = run.result()
    assert (result["taken"], result["brought"], result["time_outs"]) == (1, 0, 1)
    assert result["score"] == 2.0 + FAILURE_SCORE


@pytest.mark.parametrize("how", [Happening.TIME_OUT, Happening.BORDER])
def test_in_play_a_failure_while_it_carries_brings_an_object_back(how: Happening) -> None:
    run = carrying(ends=False)
    if how is Happening.BORDER:
        step = run.advance(Pose(0.0, 2.9), 0.1)
    else:
        step = run.advance(ORIGIN, LIMIT_S)
    assert (step.happening, step.robot_to_origin, step.ended) == (how, True, False)
    assert dict(run.places()) == {0: run.target}
    assert from_mat_m(run, run.target) >= OBJECT_FROM_MAT_M
    assert not facts(run, ORIGIN)["carries"]
    assert run.object_s == 0
    assert run.advance(run.mat, 0.1).happening == NOTHING, "its hands are empty"
    assert run.advance(run.target, 0.0).happening == TAKEN
    assert run.advance(run.mat, 0.0).happening == BROUGHT
    result = run.result()
    assert (result["taken"], result["brought"], result["completed"]) == (2, 1, False)


def test_it_plays_on_without_end() -> None:
    run = bring(ends=False)
    for _ in range(30):
        assert not run.advance(run.target, 0.0).ended
        assert not run.advance(run.mat, 0.0).ended
    assert (run.result()["taken"], run.result()["brought"]) == (30, 30)


def test_facts_are_of_the_object_first_and_then_of_the_mat() -> None:
    run = bring()
    run.advance(ORIGIN, 0.4)
    before = facts(run, ORIGIN)
    assert (before["carries"], before["brought"]) == (False, 0)
    assert math.hypot(before["target_ahead_m"], before["target_left_m"]) == pytest.approx(
        math.hypot(run.target.x_m, run.target.y_m)
    )
    run.advance(run.target, 0.0)
    assert math.isnan(facts(run, ORIGIN)["seen_left_rad"]), "the picture still shows the object"
    run.advance(ORIGIN, 0.4)
    told = facts(run, ORIGIN)
    assert told["carries"]
    for name in ("target", "aim"):
        found = (told[f"{name}_ahead_m"], told[f"{name}_left_m"])
        assert found == pytest.approx((run.mat.x_m, run.mat.y_m))
    assert told["seen_left_rad"] == told["mat_left_rad"]
    run.advance(run.mat, 0.0)
    assert facts(run, ORIGIN)["brought"] == 1


def test_the_mat_is_in_view_ahead_and_not_from_too_far() -> None:
    run = carrying()
    run.advance(ORIGIN, 0.4)
    near = facts(run, by_mat(run, -MAT_SEEN_M + 0.01))
    far = facts(run, by_mat(run, -MAT_SEEN_M - 0.01))
    assert far["mat_left_rad"] == far["seen_left_rad"] == math.pi
    assert abs(near["mat_left_rad"]) <= math.pi
    ahead = replace(by_mat(run, -0.6), yaw_rad=run.mat.yaw_rad)
    assert facts(run, ahead)["mat_left_rad"] == pytest.approx(0.0, abs=1e-6)
    to_its_right = replace(ahead, yaw_rad=run.mat.yaw_rad - 0.3)
    assert facts(run, to_its_right)["mat_left_rad"] > 0.3


def test_a_mat_that_a_whole_turn_did_not_show_is_looked_for_from_the_middle() -> None:
    run = carrying()
    away = 2.0 / math.hypot(run.mat.x_m, run.mat.y_m)
    far = Pose(-run.mat.x_m * away, -run.mat.y_m * away)
    told = facts(run, far)
    for step in range(16):
        robot = replace(far, yaw_rad=0.5 * step)
        run.advance(robot, 0.1)
        told = facts(run, robot)
        assert math.isinf(told["suspect_ahead_m"]) == (0.5 * step < 2.2 * math.pi)
        assert told == facts(run, robot), "asking again changes nothing"
    assert math.hypot(told["suspect_ahead_m"], told["suspect_left_m"]) == pytest.approx(2.0)
    looks = replace(ORIGIN, yaw_rad=math.atan2(run.mat.y_m, run.mat.x_m))
    run.advance(looks, 0.1)
    seen = facts(run, looks)
    assert abs(seen["mat_left_rad"]) < 0.01
    assert math.isinf(seen["suspect_ahead_m"])


def test_pictures_show_object_and_mat_and_say_which() -> None:
    run, rng = bring(seed=2), np.random.default_rng(0)
    told: list[tuple[Any, ...]] = []
    for _ in range(300):
        pose = SIGHT.scatter(run, rng)
        told.append(tuple(facts(run, pose, seen_s=0.4).values()))
        assert from_mat_m(run, run.target) >= OBJECT_FROM_MAT_M
    known = np.array(told, TASK.facts)
    shown = SIGHT.shown(known)
    assert np.isfinite(shown).all()
    cube, mat = shown[:, 1] == 1, shown[:, 4] == 1
    np.testing.assert_array_equal(cube, np.abs(known["seen_left_rad"]) <= IN_VIEW_RAD)
    np.testing.assert_array_equal(mat, np.abs(known["mat_left_rad"]) <= IN_VIEW_RAD)
    np.testing.assert_array_equal(shown[:, 0] == 1, cube | mat)
    assert 0.2 < mat.mean() < 0.8
    assert 0.2 < cube.mean() < 0.9
    assert not shown[~cube][:, 1:4].any(), "of no account"
    assert not shown[~mat][:, 4:].any()
    assert (np.sign(shown[mat, 5]) == np.sign(known["mat_left_rad"][mat])).all()
    np.testing.assert_array_equal(SIGHT.mirrored(shown), shown * (1, 1, -1, 1, 1, -1))


def test_its_mat_is_seen_where_it_lies(monkeypatch: pytest.MonkeyPatch) -> None:
    environment = TaskEnv("ideal", rooms=ROOMS, task="bring")
    greener: list[int] = []
    in_view: list[bool] = []
    for seed in range(24):
        laid, info = environment.reset(seed=seed)
        in_view.append(abs(info["mat_left_rad"]) < 0.8 * IN_VIEW_RAD)
        with monkeypatch.context() as without:
            without.setattr(type(TASK), "pieces", lambda *_: ())
            bare, _ = environment.reset(seed=seed)
        changed = laid.astype(int) - bare.astype(int)
        greener.append(int((changed[..., 1] - changed[..., 0] > 30).sum()))
    environment.close()
    assert any(in_view)
    for pixels, is_ahead in zip(greener, in_view, strict=True):
        assert pixels > 5 or not is_ahead
    assert min(greener) == 0, "one lies behind the robot"


def test_an_object_that_is_carried_is_out_of_the_simulated_arena() -> None:
    world = world_of("bring")
    run = world.episode
    assert isinstance(run, BringEpisode)
    run.target = Pose(0.5, 0.0)
    run.mat = Pose(1.0, 0.0)

    def height_m() -> float:
        return float(world.simulation.snapshot().moved_pos[0, 2])

    happened: list[str] = []
    while BROUGHT not in happened:
        happened.append(world.decide(1.0, 1.0).happening)
        carries = TAKEN in happened and BROUGHT not in happened
        assert (height_m() < -1) == carries
    assert [what for what in happened if what != NOTHING] == [TAKEN, BROUGHT]
    assert 1.0 - MAT_HALF_M - 0.01 < world.robot.x_m < 1.0


def test_its_guide_earns_most_of_what_there_is_and_standing_does_not() -> None:
    guide, standing = drives("bring", "guide"), drives("bring", "standing")
    assert sorted(guide.counts)[2] == 10
    assert guide.reward > 0.8 * guide.largest
    assert standing.reward == FAILURE_SCORE


def test_it_is_told_in_a_sentence_and_learned_from_its_last_lesson_with_the_guide() -> None:
    assert TASK.summary(bring().result()) == (
        "took 0, brought 0; border 0, time-outs 0; score 0.00"
    )
    assert TASK.course(guided=True, further=False) == ("ten",)
    assert TASK.course(guided=False, further=False) == ("one", "ten")
    assert isinstance(TASK.sight, BringSight)
    assert (ONE.largest_reward, TEN.largest_reward) == (5.0, 41.0)
