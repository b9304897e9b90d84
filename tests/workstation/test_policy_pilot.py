"""The policy that drives in a worker: as it decides by itself, decision by decision."""

import pickle
from dataclasses import fields

import numpy as np
import torch

from mbot_workstation.learn.learning.full_speed import within_full_speed
from mbot_workstation.learn.learning.memory_policy import (
    MemoryPolicy,
    PolicyInput,
    memory_policy_arguments,
)
from mbot_workstation.learn.learning.policy_pilot import PolicyPilot
from mbot_workstation.learn.worlds.segment import Decisions, Pilot, SegmentPlan
from mbot_workstation.learn.worlds.task_env import action_space, observation_space

ROBOTS, DECISIONS, UNITS = 3, 6, 8
RNG = np.random.default_rng(0)
PICTURES = RNG.integers(0, 256, (2 * DECISIONS, ROBOTS, 64, 64, 3), np.uint8)
NOISE = RNG.standard_normal((2 * DECISIONS, ROBOTS, 2)).astype(np.float32)
FORGETS = np.zeros((2 * DECISIONS, ROBOTS), np.bool_)
FORGETS[2, 1] = FORGETS[DECISIONS - 1, 2] = True
ENDED = np.zeros_like(FORGETS)
ENDED[4, 0] = True


def policy(seed: int) -> MemoryPolicy:
    torch.manual_seed(seed)
    one = MemoryPolicy(
        observation_space(),
        action_space(),
        lambda _: 1e-4,
        **memory_policy_arguments(UNITS, -1.0, 4),
    )
    torch.nn.init.normal_(one.action_net.weight, std=0.2)
    return one


def driven(pilot: Pilot, learned: MemoryPolicy | None, segment: range) -> Decisions:
    weights = None
    if learned is not None:
        weights = {name: one.numpy() for name, one in learned.state_dict().items()}
    pilot.start(SegmentPlan(weights, NOISE[segment], FORGETS[segment]))
    for now in segment:
        pilot.decide(PICTURES[now])
        pilot.arrive(ENDED[now])
    return pilot.decisions()


def test_a_pilot_decides_as_its_policy_does() -> None:
    """By the newest weights, and what robots remember goes on from segment to segment."""
    policies = policy(1), policy(2)
    sent = pickle.dumps(PolicyPilot(policies[0]))
    assert len(sent) < 100_000, "without weights, which are a megabyte"
    pilot: PolicyPilot = pickle.loads(sent)
    segments = range(DECISIONS), range(DECISIONS, 2 * DECISIONS)
    state, told = torch.zeros(ROBOTS, UNITS), torch.zeros(ROBOTS, 2)
    forgot = np.ones(ROBOTS, np.bool_)
    for learned, segment in zip(policies, segments, strict=True):
        made = driven(pilot, learned, segment)
        for place, now in enumerate(segment):
            np.testing.assert_array_equal(made.states[place], state.numpy())
            np.testing.assert_array_equal(made.previous_actions[place], told.numpy())
            np.testing.assert_array_equal(made.forgot[place], forgot)
            with torch.no_grad():
                before = PolicyInput(torch.from_numpy(PICTURES[now]), state, told)
                decided = learned.decide(before, torch.from_numpy(NOISE[now]))
            np.testing.assert_allclose(made.actions[place], decided.actions, rtol=0, atol=1e-6)
            np.testing.assert_allclose(made.known[place], decided.known, rtol=0, atol=1e-6)
            told = within_full_speed(decided.actions)
            np.testing.assert_allclose(made.wheels[place], told, rtol=0, atol=1e-6)
            forgot = ENDED[now] | FORGETS[now]
            # From what it wrote down: rounding must not add up.
            told = torch.from_numpy(made.wheels[place] * ~forgot[:, None])
            following = made.states[place + 1] if now != segment[-1] else made.after.state
            kept = (decided.state * torch.from_numpy(~forgot).float()[:, None]).numpy()
            np.testing.assert_allclose(following, kept, rtol=0, atol=1e-6)
            state = torch.from_numpy(following.copy())
        np.testing.assert_array_equal(made.after.previous_actions, told.numpy())
        np.testing.assert_array_equal(made.after.forgot, forgot)
        assert np.ptp(made.actions) > 0.5


def test_weights_stay_until_others_come() -> None:
    pilot = PolicyPilot(policy(1))
    first = driven(pilot, policy(2), range(DECISIONS))
    second = driven(pilot, None, range(DECISIONS))
    np.testing.assert_array_equal(first.known[:, :, :256], second.known[:, :, :256])
    assert not np.array_equal(first.known[0], second.known[0]), "it remembers"


def test_decisions_of_workers_stand_side_by_side() -> None:
    parts = [driven(PolicyPilot(policy(seed)), policy(seed), range(DECISIONS)) for seed in (1, 2)]
    both = Decisions.beside(parts)
    for field in fields(Decisions):
        if field.name != "after":
            one, other = (getattr(part, field.name) for part in parts)
            np.testing.assert_array_equal(getattr(both, field.name)[:, :ROBOTS], one)
            np.testing.assert_array_equal(getattr(both, field.name)[:, ROBOTS:], other)
    np.testing.assert_array_equal(both.after.state[ROBOTS:], parts[1].after.state)
    assert both.after.forgot.shape == (2 * ROBOTS,)
