import json
import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mbot_workstation.learn.worlds.task_env import TaskEnv
from mbot_workstation.sim.pose import ORIGIN, Pose
from mbot_workstation.sim.scene.scene_look import Standing
from mbot_workstation.sim.scene.target_object import RED_CUBE
from mbot_workstation.tasks.episode import NOTHING, Moment, Setting, Step
from mbot_workstation.tasks.fetch.episode import Happening
from mbot_workstation.tasks.fetch.obstacles import way_to_things_m
from mbot_workstation.tasks.fetch.rules import FAILURE_SCORE, WRONG_SCORE
from mbot_workstation.tasks.obstacles.episode import (
    FROM_START_M,
    GAP_M,
    KINDS,
    PRESSED_M,
    REACH_M,
    STUCK_S,
    ObstaclesEpisode,
    draw_obstacles,
)
from mbot_workstation.tasks.obstacles.task import TASK, ObstaclesLesson

from .driven_task import drives, world_of
from .small_world import ROOMS

ROBOT_M = 0.09
SLICE_S, SLICE_M = 0.02, 0.008
"""At full speed."""

SETTING = Setting(ROBOT_M, 2.9, (RED_CUBE.footprint,))
FEW, LAST = (lesson for lesson in TASK.lessons if isinstance(lesson, ObstaclesLesson))
BEFORE_IT = Pose(0.6, 0.0)
CARTON = Standing("carton", 1.0, 0.0, 0.2, 0.3)


def run_among(*things: Standing, ends: bool = True, objects: int = 10) -> ObstaclesEpisode:
    """A run among these alone, with the object behind the robot."""
    lesson = replace(LAST, things=(0, 0), ends_on_failure=ends, objects=objects)
    run = TASK.begin(lesson, replace(SETTING, standing=things), np.random.default_rng(0))
    run.target = Pose(-2.0, 0.0)
    return run


def press(run: ObstaclesEpisode, seconds: float, robot: Pose = BEFORE_IT) -> list[Step]:
    """Drive along +x at full speed for so long, and be pushed back."""
    steps: list[Step] = []
    for _ in range(round(seconds / SLICE_S)):
        robot = replace(robot, x_m=robot.x_m + SLICE_M)
        steps.append(run.advance(robot, SLICE_S))
        if steps[-1].ended:
            break
        robot = ORIGIN if steps[-1].robot_to_origin else pushed(robot, steps[-1])
        assert depth_m(run, robot) <= PRESSED_M + 1e-9
    return steps


def pushed(robot: Pose, step: Step) -> Pose:
    return replace(robot, x_m=robot.x_m + step.pushed_m[0], y_m=robot.y_m + step.pushed_m[1])


def depth_m(run: ObstaclesEpisode, robot: Pose) -> float:
    """How far the robot is inside of a thing."""
    return -way_to_things_m(robot, run.rules.standing, ROBOT_M)


def facts(run: ObstaclesEpisode, robot: Pose) -> Mapping[str, Any]:
    told = run.facts(Moment(robot, 100.0, robot, 99.95, camera_ahead_m=0.06))
    return dict(zip(TASK.facts.names or (), told, strict=True))


@settings(max_examples=30)
@given(st.integers(0, 10**6), st.integers(1, 8))
def test_things_leave_room_between_each_other_and_around_the_start(seed: int, number: int) -> None:
    drawn = draw_obstacles(np.random.default_rng(seed), number)
    whole = [one for one in drawn.standing if one.name in KINDS]
    legs = [one for one in drawn.standing if one.name not in KINDS]
    assert len(whole) + len(legs) / 4 == number
    assert len(drawn.pieces) >= number
    for one in drawn.standing:
        assert max(abs(one.x_m), abs(one.y_m)) < REACH_M + 0.3
        assert math.hypot(one.x_m, one.y_m) - one.radius_m > FROM_START_M - 0.1
    for one in whole:
        others = [other for other in whole if other is not one]
        assert way_to_things_m(Pose(one.x_m, one.y_m), others, one.radius_m) >= GAP_M - 1e-9
        assert way_to_things_m(Pose(one.x_m, one.y_m), legs, one.radius_m) >= GAP_M - 0.1


def test_what_stands_about_is_met_and_drawn_and_as_many_as_the_lesson_says() -> None:
    for seed in range(20):
        run = TASK.begin(FEW, SETTING, np.random.default_rng(seed))
        assert run.rules.standing == run.obstacles.standing
        assert TASK.pieces(run) == run.obstacles.pieces
        legs = sum(one.name not in KINDS for one in run.obstacles.standing)
        assert 1 <= len(run.obstacles.standing) - legs + legs / 4 <= 3
    things = (CARTON,)
    run = TASK.begin(LAST, replace(SETTING, standing=things), np.random.default_rng(0))
    assert run.rules.standing == (*things, *run.obstacles.standing)


def test_a_thing_counts_once_while_it_is_pressed_and_again_after_it_was_left() -> None:
    run = run_among(CARTON)
    steps = press(run, 2.0)
    assert [step.happening for step in steps if step.happening != NOTHING] == [Happening.WRONG]
    assert sum(step.score for step in steps) == WRONG_SCORE
    assert run.advance(Pose(0.5, 0.0), 0.1).pushed_m == (0.0, 0.0)
    again = press(run, 1.0)
    assert sum(step.score for step in again) == WRONG_SCORE
    assert (run.result()["wrong_things"], run.result()["stuck"]) == (2, 0)


def test_who_presses_on_for_three_seconds_is_stuck() -> None:
    run = run_among(CARTON)
    steps = press(run, 5.0)
    last = steps[-1]
    assert (last.happening, last.score, last.ended) == (Happening.STUCK, FAILURE_SCORE, True)
    first = next(number for number, step in enumerate(steps) if step.pushed_m != (0.0, 0.0))
    assert (len(steps) - first) * SLICE_S == pytest.approx(STUCK_S, abs=2 * SLICE_S)
    result = run.result()
    assert (result["stuck"], result["completed"], run.ended) == (1, False, True)
    assert result["score"] == WRONG_SCORE + FAILURE_SCORE == sum(step.score for step in steps)
    assert json.loads(json.dumps(result))["stuck"] == 1


def test_who_stands_where_it_was_pushed_to_pushes_nothing() -> None:
    for angle in np.linspace(-0.8, 0.8, 41):
        run = run_among(CARTON)
        away_m = CARTON.radius_m + run.rules.touch_radius_m - 0.02
        robot = Pose(CARTON.x_m - away_m * math.cos(angle), CARTON.y_m - away_m * math.sin(angle))
        for _ in range(round(2 * STUCK_S / SLICE_S)):
            x_m, y_m = run.advance(robot, SLICE_S).pushed_m
            robot = Pose(robot.x_m + x_m, robot.y_m + y_m)
        assert run.result()["stuck"] == 0


def test_three_seconds_in_parts_are_none() -> None:
    run = run_among(CARTON)
    for _ in range(3):
        assert not any(step.ended for step in press(run, 2.5))
        run.advance(Pose(0.5, 0.0), 0.1)
    assert run.result()["stuck"] == 0


def test_in_play_who_is_stuck_goes_on_from_the_origin() -> None:
    run = run_among(CARTON, ends=False, objects=0)
    before = run.target
    steps = press(run, 4.0)
    (stuck,) = [step for step in steps if step.happening == Happening.STUCK]
    assert (stuck.robot_to_origin, stuck.ended, stuck.pushed_m) == (True, False, (0.0, 0.0))
    assert run.target != before
    assert run.advance(ORIGIN, 0.1) == Step()
    assert not run.ended
    again = press(run, 2.9)
    assert Happening.STUCK not in [step.happening for step in again], "it counts anew"
    assert run.result()["stuck"] == 1


def test_between_two_things_it_is_pushed_out_of_both() -> None:
    beside = Standing("bin", 1.0, 0.42, 0.2, 0.3)
    run = run_among(CARTON, beside)
    robot = Pose(0.7, 0.21)
    for _ in range(60):
        robot = replace(robot, x_m=robot.x_m + SLICE_M)
        robot = pushed(robot, run.advance(robot, SLICE_S))
    assert depth_m(run, robot) < 0.005
    assert robot.x_m < 0.85
    assert run.result()["wrong_things"] == 2


def test_the_border_and_the_object_are_as_in_fetch() -> None:
    run = run_among(CARTON)
    touch = run.advance(run.target, 0.0)
    assert (touch.happening, touch.score) == (Happening.TOUCH, 2.0)
    border = run.advance(Pose(0.0, 2.9), 0.1)
    assert (border.happening, border.ended) == (Happening.BORDER, True)
    assert run.result()["touches"] == 1


def test_it_is_led_around_what_stands_in_the_way_and_straight_where_nothing_does() -> None:
    run = run_among(CARTON)
    run.target = Pose(2.0, 0.05)
    around = facts(run, ORIGIN)
    assert (around["target_ahead_m"], around["target_left_m"]) == (2.0, 0.05)
    assert abs(around["aim_left_m"]) > 0.25
    free = facts(run, Pose(1.0, 1.0, math.pi / 2))
    assert free["aim_ahead_m"] == free["target_ahead_m"]
    robot = ORIGIN
    for _ in range(200):
        aim = run.aim_from(robot)
        away_m = max(math.hypot(aim.x_m - robot.x_m, aim.y_m - robot.y_m), 0.02)
        x_m = robot.x_m + (aim.x_m - robot.x_m) * 0.02 / away_m
        y_m = robot.y_m + (aim.y_m - robot.y_m) * 0.02 / away_m
        robot = Pose(x_m, y_m)
        step = run.advance(robot, 0.05)
        assert step.pushed_m == (0.0, 0.0)
        if step.happening == Happening.TOUCH:
            break
    assert run.result()["touches"] == 1
    assert run.result()["wrong_things"] == 0


def test_hidden_it_is_looked_for_from_elsewhere_after_a_turn_in_vain() -> None:
    run = run_among(CARTON)
    run.target = Pose(2.0, 0.0)
    run.advance(ORIGIN, 0.1)
    robot, told = ORIGIN, facts(run, ORIGIN)
    for step in range(16):
        robot = replace(ORIGIN, yaw_rad=0.5 * step)
        run.advance(robot, 0.2)
        told = facts(run, robot)
        assert told["seen_left_rad"] == math.pi, "the carton hides it"
        assert math.isinf(told["suspect_ahead_m"]) == (0.5 * step < 2.2 * math.pi)
    assert facts(run, robot) == facts(run, robot)
    assert math.hypot(told["suspect_ahead_m"], told["suspect_left_m"]) > 0.2
    beside = Pose(1.0, 1.0, -math.pi / 4)
    run.advance(beside, 0.1)
    assert math.isinf(facts(run, beside)["suspect_ahead_m"]), "now it is in view"
    assert math.isinf(facts(run, robot)["suspect_ahead_m"]), "and a turn begins anew"


def test_facts_change_nothing_that_counts() -> None:
    def ended(times: int) -> Mapping[str, Any]:
        run = TASK.begin(LAST, SETTING, np.random.default_rng(3))
        robot = ORIGIN
        for _ in range(200):
            for _ in range(times):
                facts(run, robot)
            aim = run.aim_from(robot)
            heading = math.atan2(aim.y_m - robot.y_m, aim.x_m - robot.x_m)
            x_m, y_m = robot.x_m + 0.03 * math.cos(heading), robot.y_m + 0.03 * math.sin(heading)
            robot = Pose(x_m, y_m, heading)
            run.advance(robot, 0.1)
        return run.result()

    once = ended(1)
    assert once["touches"] > 1
    assert once == ended(2)


def test_a_virtual_robot_plays_among_as_many_things_without_end() -> None:
    lesson = TASK.play(2.0, None, ends_on_failure=False)
    assert isinstance(lesson, ObstaclesLesson)
    assert (lesson.objects, lesson.spawn_farthest_m, lesson.things) == (0, 2.0, (3, 8))
    run = TASK.begin(lesson, SETTING, np.random.default_rng(1))
    for _ in range(30):
        assert not run.advance(run.target, 0.0).ended
    assert run.result()["touches"] == 30


def test_a_robot_at_full_speed_does_not_go_through_a_carton() -> None:
    world = world_of("obstacles")
    run = world.episode = run_among(CARTON)
    run.target = Pose(-2.0, 0.0)
    happened: list[str] = []
    while not run.ended:
        happened.append(str(world.decide(1.0, 1.0).happening))
        if not run.ended:
            assert depth_m(run, world.robot) <= PRESSED_M + 1e-6
            assert world.robot == world.simulation.pose, "the wheels are where the task says"
    assert world.robot.x_m < CARTON.x_m
    assert [what for what in happened if what != NOTHING] == ["wrong thing", "stuck"]
    assert world.robot.x_m == pytest.approx(1.0 - 0.2 - ROBOT_M, abs=0.01)


def test_a_robot_that_was_stopped_drives_away_again() -> None:
    world = world_of("obstacles")
    run = world.episode = run_among(Standing("bin", 0.5, 0.0, 0.15, 0.3))
    run.target = Pose(-2.0, 0.0)
    for _ in range(5):
        world.decide(1.0, 1.0)
    assert depth_m(run, world.robot) == pytest.approx(PRESSED_M, abs=1e-6)
    for _ in range(10):
        world.decide(-1.0, -1.0)
    assert world.robot.x_m < -0.5
    assert run.result()["wrong_things"] == 1


def test_things_are_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    environment = TaskEnv("ideal", rooms=ROOMS, task="obstacles")
    changed: list[int] = []
    for seed in range(3):
        furnished, _ = environment.reset(seed=seed)
        with monkeypatch.context() as without:
            without.setattr(type(TASK), "pieces", lambda *_: ())
            bare, _ = environment.reset(seed=seed)
        changed.append(int((furnished != bare).any(axis=2).sum()))
    environment.close()
    assert max(changed) > 50


def test_its_guide_earns_most_of_what_there_is_and_standing_does_not() -> None:
    guide, standing = drives("obstacles", "guide"), drives("obstacles", "standing")
    assert sorted(guide.counts)[2] == 10
    assert guide.reward > 0.8 * guide.largest
    assert standing.reward == FAILURE_SCORE


def test_it_is_learned_from_its_last_lesson_with_the_guide() -> None:
    assert TASK.course(guided=True, further=False) == ("3-to-8",)
    assert TASK.course(guided=False, further=True) == ("3-to-8",)
    assert TASK.course(guided=False, further=False) == ("few", "3-to-8")
    assert "stuck" in TASK.happenings
