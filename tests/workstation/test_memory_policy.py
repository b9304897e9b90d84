"""The policy's memory: what an update computes is what the robots did, and it can be told apart."""

import numpy as np
import pytest
import torch

from mbot_workstation.learn.learning.memory_policy import (
    MemoryPolicy,
    PolicyInput,
    critic_inputs,
    memory_policy_arguments,
    truth,
)
from mbot_workstation.learn.worlds.task_env import action_space, observation_space
from mbot_workstation.sim.effects.body_record import BODY_RECORD
from mbot_workstation.tasks.fetch.task import TASK

TRUTH = critic_inputs(TASK.critic)
RNG = np.random.default_rng(8)
PICTURES = RNG.integers(0, 256, (9, 3, 64, 64, 3)).astype(np.uint8)
ACTIONS = RNG.uniform(-1, 1, (9, 3, 2)).astype(np.float32)
FORGETS = np.zeros((9, 3), np.bool_)
FORGETS[2, 1] = FORGETS[6] = True


def made(units: int) -> MemoryPolicy:
    torch.manual_seed(3)
    arguments = memory_policy_arguments(units, -1.0, TRUTH)
    policy = MemoryPolicy(observation_space(), action_space(), lambda _: 1e-3, **arguments)
    torch.nn.init.normal_(policy.action_net.weight, std=0.1)
    return policy


def driven(policy: MemoryPolicy) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Nine decisions of three robots: wheels, previous actions, forgettings."""
    state, told = torch.zeros(3, policy.units), torch.zeros(3, 2)
    wheels: list[torch.Tensor] = []
    previous: list[torch.Tensor] = []
    forgot = np.ones(3, np.bool_)
    all_forgot: list[np.ndarray] = []
    for pictures, actions, forget in zip(PICTURES, ACTIONS, FORGETS, strict=True):
        previous.append(told)
        all_forgot.append(forgot)
        before = PolicyInput(torch.from_numpy(pictures), state, told)
        with torch.no_grad():
            decided = policy.decide(before)
        wheels.append(decided.actions)
        keep = torch.from_numpy(~forget).float().unsqueeze(1)
        state, told = decided.state * keep, torch.from_numpy(actions) * keep
        forgot = forget
    return torch.stack(wheels), torch.stack(previous), torch.tensor(np.array(all_forgot)).float()


@pytest.mark.parametrize("units", [16, 0])
def test_an_update_sees_what_the_robots_remembered(units: int) -> None:
    policy = made(units)
    wheels, previous, forgot = driven(policy)
    known = policy.unroll(torch.from_numpy(PICTURES), previous, forgot, torch.zeros(3, units))
    torch.testing.assert_close(
        policy.action_net(known).unflatten(0, (9, 3)), wheels, rtol=0, atol=1e-5
    )


def test_the_past_counts_until_it_is_forgotten() -> None:
    policy = made(16)
    _, previous, forgot = driven(policy)
    pictures = torch.from_numpy(PICTURES).float().requires_grad_()
    known = policy.unroll(pictures, previous, forgot, torch.zeros(3, 16)).unflatten(0, (9, 3))
    known[5].sum().backward()
    assert pictures.grad is not None
    reach = pictures.grad.abs().amax(dim=(2, 3, 4)) > 0  # (moments, robots)
    assert reach[:6, 0].all(), "the first robot remembers from its beginning"
    assert not reach[:3, 1].any(), "the second forgot after its third decision"
    assert reach[3:6, 1].all()
    assert not reach[6:].any(), "nobody knows the future"


def test_the_last_action_is_a_part_of_what_is_remembered() -> None:
    policy = made(16)
    _, previous, forgot = driven(policy)
    arguments = (torch.from_numpy(PICTURES), forgot, torch.zeros(3, 16))
    ours = policy.unroll(arguments[0], previous, *arguments[1:])
    other = policy.unroll(arguments[0], -previous, *arguments[1:])
    assert not torch.allclose(ours, other)


def test_what_is_drawn_is_as_likely_as_is_said() -> None:
    policy = made(16)
    many = 4000
    before = PolicyInput(
        torch.from_numpy(np.repeat(PICTURES[0][:1], many, axis=0)),
        torch.zeros(many, 16),
        torch.zeros(many, 2),
    )
    with torch.no_grad():
        decided, plain = policy.decide(before, torch.randn(many, 2)), policy.decide(before)
    noise = torch.exp(torch.tensor(-1.0))
    spread = (decided.actions - plain.actions) / noise
    assert spread.mean().abs() < 0.06, "4,000 draws: 4 standard errors"
    assert (spread.std() - 1).abs() < 0.05
    judged = policy.judge(decided.known, decided.actions, torch.zeros(many, TRUTH))
    expected = torch.distributions.Normal(plain.actions, noise).log_prob(decided.actions).sum(1)
    torch.testing.assert_close(judged.log_probs, expected)
    assert judged.values.shape == (many,)


def test_the_critic_is_told_finite_numbers_of_about_one() -> None:
    situations = np.zeros(2, TASK.facts)
    situations["target_ahead_m"] = (2.5, np.nan)
    situations["time_left_s"] = 66
    bodies = np.zeros(2, BODY_RECORD)
    bodies["camera_latency_ms"] = 190
    told = truth(TASK.critic, situations, bodies)
    assert told.shape == (2, TRUTH)
    assert np.isfinite(told).all()
    assert np.abs(told).max() < 2.5


def test_a_policy_begins_with_the_advice_of_its_eye_whatever_it_remembers() -> None:
    policy, advice = made(16), torch.nn.Linear(256, 2)
    pictures = torch.from_numpy(PICTURES[0])
    policy.begin_with(advice)
    remembers = PolicyInput(pictures, torch.randn(3, 16), torch.rand(3, 2))
    with torch.no_grad():
        wheels = policy.decide(remembers).actions
        torch.testing.assert_close(wheels, advice(policy.features_extractor(pictures.float())))
    assert policy.action_net.weight is not advice.weight, "a copy, which is learned on"
