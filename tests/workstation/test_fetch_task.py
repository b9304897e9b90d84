import json
import math

import numpy as np
import pytest

from mbot_workstation.sim.pose import ORIGIN, Pose
from mbot_workstation.sim.scene.scene_look import Standing
from mbot_workstation.tasks.episode import NOTHING, Moment
from mbot_workstation.tasks.fetch.episode import FACTS, FetchEpisode, Happening
from mbot_workstation.tasks.fetch.rules import WRONG_SCORE, FetchRules


def task(**rules: object) -> FetchEpisode:
    return FetchEpisode(FetchRules(**rules), np.random.default_rng(0))  # pyright: ignore


def test_a_perfect_run_gives_the_paper_maximum() -> None:
    fetch = task(objects=10)
    total = 0.0
    for number in range(10):
        step = fetch.advance(fetch.target, 0.0)
        assert step.happening is Happening.TOUCH
        assert step.ended == (number == 9)
        total += step.score
    result = fetch.result()
    assert total == result["score"] == 21
    assert result["completed"]
    with pytest.raises(RuntimeError, match="ended"):
        fetch.advance(ORIGIN, 0.4)


def test_the_clock_starts_anew_with_every_touch() -> None:
    fetch = task(objects=0)
    fetch.advance(ORIGIN, 30.0)
    first = fetch.advance(fetch.target, 3.4)
    assert first.score == pytest.approx(1.5)
    assert fetch.object_s == 0
    second = fetch.advance(fetch.target, 6.68)
    assert second.score == pytest.approx(1.9)
    assert fetch.result()["seconds_per_touch"] == (33.4, 6.68)


def test_167_decisions_are_the_limit() -> None:
    fetch = task()
    for _ in range(166):
        assert fetch.advance(ORIGIN, 0.4).happening == NOTHING
    step = fetch.advance(ORIGIN, 0.4)
    assert (step.happening, step.score, step.ended) == (Happening.TIME_OUT, -1, True)
    assert not step.robot_to_origin


def test_the_border_ends_a_training_run() -> None:
    step = task().advance(Pose(0, 2.9), 0.4)
    assert (step.happening, step.score, step.ended) == (Happening.BORDER, -1, True)


def test_otherwise_the_robot_goes_on_from_the_origin() -> None:
    fetch = task(ends_on_failure=False, objects=2)
    before = fetch.target
    step = fetch.advance(Pose(0, 2.9), 0.4)
    assert step.robot_to_origin
    assert not step.ended
    assert fetch.target != before
    assert math.hypot(fetch.target.x_m, fetch.target.y_m) >= 0.4
    assert fetch.object_s == 0
    fetch.advance(fetch.target, 0.0)
    last = fetch.advance(fetch.target, 0.0)
    result = fetch.result()
    assert last.ended
    assert last.score == 2, "no bonus for a complete run after a failure"
    found = (result["border_contacts"], result["touches"], result["completed"])
    assert found == (1, 2, False)
    assert result["score"] == 3


def test_the_result_is_json() -> None:
    fetch = task()
    fetch.advance(fetch.target, 1.0)
    assert json.loads(json.dumps(fetch.result()))["touches"] == 1


CAN = Standing("can", 1.0, 0.0, 0.04, 0.12)


def test_running_into_a_thing_costs_once_until_the_robot_has_left_it() -> None:
    fetch = task(standing=(CAN,))
    beside = Pose(CAN.x_m - 0.12, 0.0)
    away = Pose(CAN.x_m - 0.14, 0.0)
    told = [fetch.advance(robot, 0.4) for robot in (away, beside, beside, away, beside)]
    assert [step.happening for step in told] == [
        NOTHING, Happening.WRONG, NOTHING, NOTHING, Happening.WRONG
    ]  # fmt: skip
    assert [step.score for step in told] == [0, WRONG_SCORE, 0, 0, WRONG_SCORE]
    assert not any(step.ended for step in told)
    assert (fetch.result()["wrong_things"], fetch.result()["score"]) == (2, 2 * WRONG_SCORE)


def test_facts_tell_the_way_around_a_thing_and_that_it_hides_the_object() -> None:
    def facts(standing: tuple[Standing, ...]) -> dict[str, float]:
        fetch = task(standing=standing)
        fetch.advance(ORIGIN, 0.4)
        fetch.target = Pose(2.0, 0.0)
        told = fetch.facts(Moment(ORIGIN, 0.4, ORIGIN, 0.35, camera_ahead_m=0.06))
        return dict(zip(FACTS.names or (), told, strict=True))

    free, blocked = facts(()), facts((CAN,))
    assert (free["aim_ahead_m"], free["aim_left_m"], free["seen_left_rad"]) == (2.0, 0.0, 0.0)
    assert (blocked["target_ahead_m"], blocked["target_left_m"]) == (2.0, 0.0)
    assert abs(blocked["aim_left_m"]) > CAN.radius_m
    assert blocked["seen_left_rad"] == math.pi


def test_a_thing_of_its_colour_is_suspect_until_it_was_seen_from_nearby() -> None:
    ball = Standing("ball", 1.5, 0.0, 0.05, 0.1, is_alike=True)
    fetch = task(standing=(ball, CAN), objects=2)
    fetch.target = Pose(-2.0, 0.0)

    def suspect(robot: Pose) -> float:
        told = fetch.facts(Moment(robot, 0.4, robot, 0.35, camera_ahead_m=0.06))
        return dict(zip(FACTS.names or (), told, strict=True))["suspect_ahead_m"]

    beside, turned = Pose(0.0, 0.69), Pose(0.0, 0.69, math.pi)
    assert suspect(beside) == pytest.approx(1.5), "ahead, nothing in the way"
    assert math.isinf(suspect(ORIGIN)), "the can hides it"
    assert math.isinf(suspect(turned)), "behind"
    assert math.isinf(suspect(Pose(0.7, 0.2))), "near: it is seen to be none"
    assert math.isinf(suspect(beside)), "and remembered"
    fetch.advance(fetch.target, 0.0)
    assert suspect(beside) == pytest.approx(1.5), "the next object may stand there"
