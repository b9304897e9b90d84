import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from mbot_workstation.training.fetch_vec_env import FetchVecEnv
from mbot_workstation.training.guidance import (
    AskTheGuide,
    GuidedRolloutBuffer,
    advice_loss,
    guide_weight,
)
from mbot_workstation.training.guide import SEARCH_TURN, Guide
from mbot_workstation.training.learner import LearnerSettings, make_learner
from mbot_workstation.training.presets import preset

NOMINAL = preset("nominal")


def advice(ahead_m: float, left_m: float) -> np.ndarray:
    return Guide(1, NOMINAL).act(np.array([[ahead_m, left_m]]))[0]


def test_what_the_camera_cannot_see_is_searched_clockwise() -> None:
    for ahead_m, left_m in ((-1.0, 0.1), (0.5, 1.0), (0.5, -1.0), (0.1, 0.5)):
        np.testing.assert_allclose(advice(ahead_m, left_m), (SEARCH_TURN, -SEARCH_TURN))


def test_what_it_sees_is_driven_at() -> None:
    left, right = advice(2.0, 0.0)
    assert left == pytest.approx(right, abs=0.05)
    assert left > 0.9
    left, right = advice(1.0, 0.3)
    assert right > left > 0
    left, right = advice(1.0, -0.3)
    assert left > right > 0


def test_without_a_target_there_is_no_advice() -> None:
    assert np.isnan(advice(math.nan, math.nan)).all()


def test_unknown_advice_costs_nothing_and_has_no_gradient() -> None:
    wheels = torch.tensor([[0.5, 0.5], [0.2, -0.2]], requires_grad=True)
    asked = torch.tensor([[math.nan, math.nan], [0.2, 0.2]])
    loss = advice_loss(wheels, asked)
    assert float(loss.detach()) == pytest.approx(0.16)
    loss.backward()
    assert wheels.grad is not None
    assert wheels.grad[0].tolist() == [0.0, 0.0]
    assert torch.isfinite(wheels.grad).all()


@given(st.integers(0, 10**7), st.integers(0, 10**6))
def test_the_guides_weight_falls_to_nothing(decisions: int, guided: int) -> None:
    weight = guide_weight(decisions, guided)
    assert 0.0 <= weight <= 1.0
    assert (weight == 0.0) == (decisions >= guided)


def test_advice_stays_with_its_observation_and_teaches() -> None:
    """A few updates bring the student's wheels nearer to what the guide would have done."""
    settings = LearnerSettings(steps_per_robot=32, batch=32, guided_decisions=10**6)
    with FetchVecEnv(robots=2, seed=1, preset="ideal", lesson="4", workers=1) as environment:
        learner = make_learner(environment, settings, seed=0)
        asker = AskTheGuide(Guide(2, preset("ideal")), environment)
        distances: list[float] = []
        for _ in range(6):
            learner.learn(64, callback=asker, reset_num_timesteps=False)
            buffer = learner.rollout_buffer
            assert isinstance(buffer, GuidedRolloutBuffer)
            (batch,) = buffer.get(64)
            with torch.no_grad():
                wheels, _, _ = learner.policy(batch.observations, deterministic=True)
            distances.append(float(advice_loss(wheels, batch.advice)) / 64)
    assert np.mean(distances[-2:]) < distances[0]
