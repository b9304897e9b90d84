"""Rewards of one's own: what they are told, and that what they pay is counted."""

import math

import numpy as np
import pytest

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.sim.pose import ORIGIN, Pose
from mbot_workstation.sim.scene.target_object import RED_CUBE
from mbot_workstation.tasks.episode import NOTHING, Moment, Setting
from mbot_workstation.tasks.fetch.lessons import FetchLesson
from mbot_workstation.tasks.fetch.paid import PaidFetch, PaidRun, Reward, Situation

told: list[Situation] = []


def way(now: Situation) -> float:
    told.append(now)
    return now.driven_m


def nearer(now: Situation) -> float:
    return 10 * now.nearer_m


FAR = FetchLesson("far", 2.5, objects=10)


class Paid(PaidFetch):
    """Two rewards more."""

    name = "paid"
    lessons = (FAR,)
    rewards = (way, nearer)


@pytest.fixture
def run() -> PaidRun:
    told.clear()
    setting = Setting(0.09, 2.9, (RED_CUBE.footprint,))
    return Paid().begin(FAR, setting, np.random.default_rng(3))


def facts(run: PaidRun, robot: Pose) -> dict[str, float]:
    values = run.facts(Moment(robot, 0.1, robot, 0.1, 0.1))
    return dict(zip(Paid.facts.names or (), values, strict=True))


def test_a_reward_is_told_what_happened_just_now(run: PaidRun) -> None:
    heading = math.atan2(run.target.y_m, run.target.x_m)
    there = Pose(0.03 * math.cos(heading), 0.03 * math.sin(heading), heading)
    away_m = math.hypot(run.target.x_m, run.target.y_m)
    step = run.advance(there, 0.1)
    (now,) = told
    assert (now.robot, now.object, now.happening) == (there, run.target, NOTHING)
    assert now.driven_m == pytest.approx(0.03)
    assert now.nearer_m == pytest.approx(0.03)
    assert now.away_m == pytest.approx(away_m - 0.03)
    assert now.bearing_rad == pytest.approx(0.0, abs=1e-9)
    assert now.turned_rad == pytest.approx(heading)
    assert (now.object_s, now.elapsed_s, now.touching) == (0.1, 0.1, 0)
    assert step.score == pytest.approx(0.03 + 0.3)


def test_what_each_reward_paid_adds_up(run: PaidRun) -> None:
    first, second = Pose(0.02, 0.0), Pose(0.02, 0.03)
    paid = run.advance(first, 0.1).score + run.advance(second, 0.1).score
    known = facts(run, second)
    assert Paid.terms == ("way", "nearer")
    assert known["way"] == pytest.approx(0.05)
    assert known["way"] + known["nearer"] == pytest.approx(paid)
    assert run.result()["score"] == pytest.approx(paid, abs=1e-4)


def test_to_be_put_back_is_no_way_driven(run: PaidRun) -> None:
    rules = FetchLesson("play", 2.5, objects=0, ends_on_failure=False)
    setting = Setting(0.09, 2.9, (RED_CUBE.footprint,))
    run = Paid().begin(rules, setting, np.random.default_rng(3))
    run.advance(Pose(2.88, 0.0), 0.1)
    told.clear()
    assert run.advance(Pose(2.91, 0.0), 0.1).robot_to_origin
    run.advance(ORIGIN, 0.1)
    assert told[-1].driven_m == 0.0


def test_what_is_no_number_is_told_with_the_rewards_name() -> None:
    def forgets(_now: Situation) -> float:
        return None  # pyright: ignore

    rules = FAR.rules
    run = PaidRun(rules, np.random.default_rng(0), (forgets,))
    with pytest.raises(ConfigurationError, match="the reward forgets gave None"):
        run.advance(ORIGIN, 0.1)


@pytest.mark.parametrize("rewards", [(way, way), (lambda _: 0.0, lambda _: 1.0)])
def test_rewards_have_names_of_their_own(rewards: tuple[Reward, ...]) -> None:
    with pytest.raises(ConfigurationError, match="call it otherwise"):
        type("Twice", (PaidFetch,), {"rewards": rewards})


def test_no_reward_is_called_as_a_fact() -> None:
    def border(_now: Situation) -> float:
        return 0.0

    with pytest.raises(ConfigurationError, match="border"):
        type("Taken", (PaidFetch,), {"rewards": (border,)})
