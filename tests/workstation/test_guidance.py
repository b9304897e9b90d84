import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from mbot_workstation.training.drivers.guide import SEARCH_TURN, Guide
from mbot_workstation.training.learning.advice_memory import AdviceMemory
from mbot_workstation.training.learning.guidance import (
    AskTheGuide,
    GuidedRolloutBuffer,
    advice_loss,
    guide_weight,
)
from mbot_workstation.training.learning.learner import LearnerSettings, make_learner
from mbot_workstation.training.worlds.fetch_vec_env import FetchVecEnv
from mbot_workstation.variation.presets import preset

NOMINAL = preset("nominal")


def advice(ahead_m: float, left_m: float, seen_left_rad: float | None = None) -> np.ndarray:
    if seen_left_rad is None:  # a robot that stands: it sees where the object is
        seen_left_rad = math.atan2(left_m, ahead_m - 0.06)
    return Guide(1, NOMINAL).act(np.array([[ahead_m, left_m]]), np.array([seen_left_rad]))[0]


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


def test_what_a_picture_shows_counts_though_the_robot_has_turned_past_it() -> None:
    left, right = advice(0.7, 0.7, seen_left_rad=0.4)
    assert right > left, "back to it, not once around"
    np.testing.assert_allclose(advice(1.0, 0.3, seen_left_rad=0.6), (SEARCH_TURN, -SEARCH_TURN))


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


def pictures(count: int, level: int) -> np.ndarray:
    return np.full((count, 4, 4, 3), level, np.uint8)


def test_the_memory_keeps_the_newest_known_advice_with_its_pictures() -> None:
    memory = AdviceMemory(5, (4, 4, 3))
    unknown = np.array([[0.1, 0.1], [np.nan, np.nan], [0.1, 0.1]], np.float32)
    memory.add(pictures(3, 1), unknown)
    assert len(memory) == 2
    memory.add(pictures(4, 2), np.full((4, 2), 0.2, np.float32))
    assert len(memory) == 5
    batch = memory.draw(200)
    for picture, advised in zip(batch.pictures, batch.advice, strict=True):
        assert advised[0] == pytest.approx(0.1 * picture[0, 0, 0])
    assert {int(level) for level in batch.pictures[:, 0, 0, 0]} == {1, 2}


def test_rehearsing_moves_the_wheels_and_nothing_else() -> None:
    settings = LearnerSettings(
        steps_per_robot=16,
        batch=16,
        epochs=1,
        guided_decisions=10**6,
        rehearsals=3,
        learning_rate=1e-9,  # PPO's own steps change nothing that could be seen
        final_learning_rate=1e-9,
    )
    with FetchVecEnv(robots=1, seed=1, preset="ideal", lesson="4", workers=1) as environment:
        learner = make_learner(environment, settings, seed=0)
        learner.learn(16, callback=AskTheGuide(Guide(1, preset("ideal")), environment))
        before = {k: v.clone() for k, v in learner.policy.state_dict().items()}
        for group in learner.policy.optimizer.param_groups:
            group["lr"] = 1e-2
        with ThreadPoolExecutor(2) as threads:
            learner._rehearse(threads)  # pyright: ignore[reportPrivateUsage]
        after = learner.policy.state_dict()
    assert not torch.equal(before["action_net.bias"], after["action_net.bias"])
    assert "_memory" in learner._excluded_save_params()  # pyright: ignore[reportPrivateUsage]
