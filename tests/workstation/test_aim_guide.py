import math

import numpy as np
import pytest
import torch

from mbot_workstation.learn.learning.full_speed import within_full_speed
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.effects.body_record import BODY_RECORD, body_record
from mbot_workstation.sim.effects.effects import RealWorldEffects
from mbot_workstation.sim.effects.presets import NOMINAL
from mbot_workstation.tasks.floor.aim_guide import AimGuide, Facts

FACTS = np.dtype([("aim_ahead_m", np.float32), ("aim_left_m", np.float32), ("seen", np.bool_)])


def guide(robots: int) -> AimGuide:
    return AimGuide(robots, NOMINAL, RobotParameters(), lambda facts: facts["seen"])


def facts(*aims: tuple[float, float]) -> Facts:
    return np.array([(*aim, number % 2 == 0) for number, aim in enumerate(aims)], FACTS)


def test_each_robot_is_driven_to_its_own_place() -> None:
    aims = facts((1.0, 0.0), (0.5, 0.5), (0.5, -0.5), (-1.0, 0.1))
    wheels = within_full_speed(torch.from_numpy(guide(4).act(aims))).numpy()
    straight, left, right, back = wheels.tolist()
    assert min(straight) > 0.9
    assert left[1] > left[0] + 0.2
    assert left == pytest.approx(right[::-1], abs=0.01)
    assert back[1] > 0.3 > -0.3 > back[0], "it turns on the spot"
    assert guide(4).shows(aims).tolist() == [True, False, True, False]


def test_without_a_place_there_is_no_advice() -> None:
    advice = guide(2).act(facts((math.nan, math.nan), (1.0, 0.0)))
    assert np.isnan(advice[0]).all()
    assert np.isfinite(advice[1]).all()


def test_what_was_driven_instead_counts_in_the_next_advice() -> None:
    one, other = guide(1), guide(1)
    turned = np.array([[-1.0, 1.0]], np.float32)
    other.drove(turned)
    place = facts((1.0, 0.3))
    assert np.diff(other.act(place)) < np.diff(one.act(place)), "its wheels turn on"
    other.forget(np.ones(1, np.bool_))
    other.drove(np.zeros((1, 2), np.float32))
    np.testing.assert_array_equal(other.act(place), guide(1).act(place))


def test_it_knows_of_a_weak_motor() -> None:
    weak = guide(1)
    body = body_record(RealWorldEffects(left_gain=0.5), RobotParameters())
    weak.become(np.array([body], BODY_RECORD))
    left, right = within_full_speed(torch.from_numpy(weak.act(facts((2.0, 0.0)))))[0].tolist()
    assert left > right + 0.2
