"""The policy that drives in a worker: as it decides by itself, decision by decision."""

import pickle
from dataclasses import fields

import numpy as np
import torch

from mbot_workstation.learn.learning.full_speed import within_full_speed
from mbot_workstation.learn.learning.memory_policy import (
    Before,
    MemoryPolicy,
    memory_policy_arguments,
)
from mbot_workstation.learn.learning.policy_pilot import Notes, PolicyPilot, Task
from mbot_workstation.learn.worlds.fetch_env import action_space, observation_space
from mbot_workstation.learn.worlds.worker_pilot import Pilot

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
    made = MemoryPolicy(
        observation_space(), action_space(), lambda _: 1e-4, **memory_policy_arguments(UNITS, -1.0)
    )
    torch.nn.init.normal_(made.action_net.weight, std=0.2)
    return made


def driven(pilot: Pilot, learned: MemoryPolicy | None, stretch: range) -> Notes:
    weights = None
    if learned is not None:
        weights = {name: one.numpy() for name, one in learned.state_dict().items()}
    pilot.start(Task(weights, NOISE[stretch], FORGETS[stretch]))
    for now in stretch:
        pilot.decide(PICTURES[now])
        pilot.arrive(ENDED[now])
    return pilot.notes()


def test_a_pilot_decides_as_its_policy_does() -> None:
    """By the newest weights, and what robots remember goes on from stretch to stretch."""
    policies = policy(1), policy(2)
    sent = pickle.dumps(PolicyPilot(policies[0]))
    assert len(sent) < 100_000, "without weights, which are a megabyte"
    pilot: PolicyPilot = pickle.loads(sent)
    stretches = range(DECISIONS), range(DECISIONS, 2 * DECISIONS)
    state, told = torch.zeros(ROBOTS, UNITS), torch.zeros(ROBOTS, 2)
    forgot = np.ones(ROBOTS, np.bool_)
    for learned, stretch in zip(policies, stretches, strict=True):
        notes = driven(pilot, learned, stretch)
        for place, now in enumerate(stretch):
            np.testing.assert_array_equal(notes.states[place], state.numpy())
            np.testing.assert_array_equal(notes.previous_actions[place], told.numpy())
            np.testing.assert_array_equal(notes.forgot[place], forgot)
            with torch.no_grad():
                before = Before(torch.from_numpy(PICTURES[now]), state, told)
                decided = learned.decide(before, torch.from_numpy(NOISE[now]))
            np.testing.assert_allclose(notes.actions[place], decided.actions, rtol=0, atol=1e-6)
            np.testing.assert_allclose(notes.known[place], decided.known, rtol=0, atol=1e-6)
            told = within_full_speed(decided.actions)
            np.testing.assert_allclose(notes.told[place], told, rtol=0, atol=1e-6)
            forgot = ENDED[now] | FORGETS[now]
            # From what it wrote down: rounding must not add up.
            told = torch.from_numpy(notes.told[place] * ~forgot[:, None])
            following = notes.states[place + 1] if now != stretch[-1] else notes.after.state
            kept = (decided.state * torch.from_numpy(~forgot).float()[:, None]).numpy()
            np.testing.assert_allclose(following, kept, rtol=0, atol=1e-6)
            state = torch.from_numpy(following.copy())
        np.testing.assert_array_equal(notes.after.told, told.numpy())
        np.testing.assert_array_equal(notes.after.forgot, forgot)
        assert np.ptp(notes.actions) > 0.5


def test_weights_stay_until_others_come() -> None:
    pilot = PolicyPilot(policy(1))
    first = driven(pilot, policy(2), range(DECISIONS))
    second = driven(pilot, None, range(DECISIONS))
    np.testing.assert_array_equal(first.known[:, :, :256], second.known[:, :, :256])
    assert not np.array_equal(first.known[0], second.known[0]), "it remembers"


def test_notes_of_workers_stand_side_by_side() -> None:
    parts = [driven(PolicyPilot(policy(seed)), policy(seed), range(DECISIONS)) for seed in (1, 2)]
    both = Notes.together(parts)
    for field in fields(Notes):
        if field.name != "after":
            one, other = (getattr(part, field.name) for part in parts)
            np.testing.assert_array_equal(getattr(both, field.name)[:, :ROBOTS], one)
            np.testing.assert_array_equal(getattr(both, field.name)[:, ROBOTS:], other)
    np.testing.assert_array_equal(both.after.state[ROBOTS:], parts[1].after.state)
    assert both.after.forgot.shape == (2 * ROBOTS,)
