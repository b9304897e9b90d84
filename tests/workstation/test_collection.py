"""Rollouts: what was seen, done and advised stays together, in whichever process it happened."""

import numpy as np
import pytest
import torch
from stable_baselines3.common.callbacks import BaseCallback

from mbot_workstation.learn.learning.collection import Collection
from mbot_workstation.learn.learning.full_speed import within_full_speed
from mbot_workstation.learn.learning.guidance import advice_loss
from mbot_workstation.learn.learning.learner import LearnerSettings, make_learner
from mbot_workstation.learn.learning.memory_policy import truth
from mbot_workstation.learn.worlds.task_vec_env import TaskVecEnv
from mbot_workstation.sim.effects.presets import preset
from mbot_workstation.tasks.fetch.guide import FetchGuide
from mbot_workstation.tasks.fetch.task import TASK

from .small_world import ROOMS


class Pointing(FetchGuide):
    """Advises nothing but where the object is, as the critic is told it, and not who forgets."""

    def become(self, bodies: np.ndarray) -> None:
        self._bodies = bodies

    def forget(self, who: np.ndarray) -> None:
        self._forgot = who

    def act(self, facts: np.ndarray) -> np.ndarray:
        pointed = truth(TASK.critic, facts, self._bodies)[:, :2]
        return np.where(self._forgot[:, None], np.nan, pointed)


def seen(truths: np.ndarray) -> np.ndarray:
    """Whether pictures show the object, by what the critic is told; 27 degrees to either side."""
    return (truths[..., 2] != 0) & (np.abs(truths[..., 2]) < 0.3 * np.radians(27))


def test_advice_stays_with_its_situation() -> None:
    """For every robot and decision, of several rollouts, segments and workers."""
    settings = LearnerSettings(steps_per_robot=48, batch=48, epochs=1, guided_decisions=10**6)
    with TaskVecEnv(4, 1, "ideal", "1", ROOMS, workers=2) as environment:
        learner = make_learner(environment, settings, seed=0, critic=TASK.critic)
        learner.collection = Collection(environment, lambda n: Pointing(n, preset("ideal")))
        for rollouts in (1, 2):
            learner.learn(rollouts * 4 * 48, reset_num_timesteps=rollouts == 1)
            lived = learner.rollout_buffer
            expected = np.where(lived.forgot[..., None] > 0, np.nan, lived.truth[..., :2])
            assert np.ptp(lived.truth[..., :2], axis=(0, 1)).min() > 0.1, "nobody has moved"
            assert lived.forgot.any()
            np.testing.assert_array_equal(lived.advice, expected)
            np.testing.assert_array_equal(lived.shows, seen(lived.truth))
            assert 0.01 < lived.shows.mean() < 0.99


@pytest.mark.slow
def test_advice_teaches() -> None:
    """After a few updates the student's wheels are nearer to what the guide would have done than
    wheels that stand still.
    """
    settings = LearnerSettings(steps_per_robot=32, batch=64, guided_decisions=10**6)
    with TaskVecEnv(robots=2, seed=1, preset="ideal", lesson="4", workers=1) as environment:
        learner = make_learner(environment, settings, seed=0, critic=TASK.critic)
        learner.collection = Collection(
            environment, lambda robots: FetchGuide(robots, preset("ideal"))
        )
        learner.learn(20 * 64)
        everything = learner.rollout_buffer.everything()
        with torch.no_grad():
            wheels = learner.policy.action_net(learner._known(everything))  # pyright: ignore[reportPrivateUsage]
        asked = torch.from_numpy(everything.advice).flatten(0, 1)
    assert advice_loss(wheels, asked) < 0.8 * advice_loss(torch.zeros_like(wheels), asked)


@pytest.mark.slow
@pytest.mark.parametrize("units", [8, 0])
def test_an_update_finds_the_rollout_as_it_was(units: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """With unchanged weights every action is as likely as when it was drawn, over the ends of
    episodes and forgettings too: pictures, states and previous actions belong together. Compared in
    whole floats, whatever this processor is faster at.
    """
    monkeypatch.setattr(torch.cpu, "get_capabilities", dict)
    settings = LearnerSettings(
        steps_per_robot=160,
        batch=320,
        epochs=1,
        memory_units=units,
        learning_rate=1e-12,
        final_learning_rate=1e-12,
    )
    with TaskVecEnv(robots=2, seed=1, preset="ideal", lesson="1", workers=1) as environment:
        learner = make_learner(environment, settings, seed=0, critic=TASK.critic)
        torch.nn.init.normal_(learner.policy.action_net.weight, std=0.2)
        learner.collection = Collection(environment)
        learner.learn(320)
    lived = learner.rollout_buffer.everything()
    assert lived.forgot.sum() > 2, "nobody has started over"
    with torch.no_grad():
        known = learner._known(lived)  # pyright: ignore[reportPrivateUsage]
        wheels = torch.distributions.Normal(
            learner.policy.action_net(known), learner.policy.log_std.exp()
        )
        found = wheels.log_prob(torch.from_numpy(lived.actions).flatten(0, 1)).sum(dim=1)
    np.testing.assert_allclose(found, lived.old_log_prob.flatten(), rtol=0, atol=2e-3)
    told = within_full_speed(torch.from_numpy(lived.actions[:-1]).flatten(0, 1))
    told = told.numpy().reshape(*lived.forgot[1:].shape, -1) * (1 - lived.forgot[1:, :, None])
    np.testing.assert_allclose(lived.previous_actions[1:], told, rtol=0, atol=1e-6)


def test_a_rollout_goes_by_what_was_learned_and_robots_go_on_remembering() -> None:
    settings = LearnerSettings(steps_per_robot=40, batch=40, memory_units=8)
    with TaskVecEnv(2, 1, "ideal", "1", ROOMS, workers=2) as environment:
        learner = make_learner(environment, settings, seed=0, critic=TASK.critic)
        policy, lived = learner.policy, learner.rollout_buffer
        collection = Collection(environment)
        environment.reset()
        collection.begin(policy)
        before = None
        for seed in (0, 1):
            with torch.no_grad():
                policy.action_net.bias.normal_(generator=torch.Generator().manual_seed(seed))
            assert collection.fill(lived, policy, 1.0, lambda _: True)
            everything = lived.everything()
            with torch.no_grad():
                known = learner._known(everything)  # pyright: ignore[reportPrivateUsage]
                mean = policy.action_net(known).unflatten(0, everything.forgot.shape).numpy()
            spread = (everything.actions - mean) / settings.noise
            assert np.abs(spread).max() < 5, "drawn about what these weights make of it"
            assert 0.8 < spread.std() < 1.2
            assert len(np.unique(spread.round(5))) > 0.98 * spread.size, "each robot's own chance"
            if before is not None:
                goes_on = lived.forgot[0] == 0
                assert goes_on.any()
                assert (lived.states[0][goes_on] != 0).any(axis=1).all()
                told = within_full_speed(torch.from_numpy(before)).numpy()
                np.testing.assert_array_equal(lived.previous_actions[0][goes_on], told[goes_on])
            before = lived.actions[-1].copy()


class Sums(BaseCallback):
    """Episodes that have ended."""

    def __init__(self, stop_after: int | None = None) -> None:
        super().__init__()
        self.episodes: list[dict[str, float]] = []
        self._stop_after = stop_after

    def _on_step(self) -> bool:
        self.episodes += [info["episode"] for info in self.locals["infos"]]
        return self._stop_after is None or self.n_calls < self._stop_after


def rollout(robots: int, workers: int, units: int = 8) -> tuple[dict[str, np.ndarray], Sums]:
    settings = LearnerSettings(
        steps_per_robot=200, batch=100, epochs=1, memory_units=units, reward_scale=0.5
    )
    with TaskVecEnv(robots, 3, "randomised", "1", ROOMS, workers) as environment:
        learner = make_learner(environment, settings, seed=0, critic=TASK.critic)
        learner.collection = Collection(
            environment, lambda n: FetchGuide(n, preset("randomised")), seed=4
        )
        sums = Sums()
        learner.learn(200 * robots, callback=sums)
        assert learner.num_timesteps == 200 * robots
    lived = learner.rollout_buffer
    names = ("observations", "actions", "rewards", "values", "log_probs", "states", "advice")
    more = ("previous_actions", "forgot", "truth", "episode_starts", "advantages", "returns")
    return {name: getattr(lived, name).copy() for name in (*names, *more)}, sums


@pytest.mark.slow
def test_a_seed_gives_the_same_rollout_whoever_is_faster() -> None:
    first, sums = rollout(4, workers=2)
    second, _ = rollout(4, workers=2)
    for name, values in first.items():
        np.testing.assert_array_equal(values, second[name], err_msg=name)
    assert sums.episodes


@pytest.mark.slow
def test_rewards_are_scaled_and_episodes_keep_theirs() -> None:
    lived, sums = rollout(2, workers=1)
    first_ends = [np.flatnonzero(starts)[1] for starts in lived["episode_starts"].T]
    returns = sorted(float(lived["rewards"][:end, row].sum()) for row, end in enumerate(first_ends))
    told = sorted(0.5 * episode["r"] for episode in sums.episodes)
    assert set(np.round(returns, 3)) <= set(np.round(told, 3))
    assert {episode["l"] for episode in sums.episodes} >= {int(end) for end in first_ends}


@pytest.mark.slow
def test_advantages_are_stable_baselines_own() -> None:
    """Generalised advantages by their definition, from what was written down."""
    lived, _ = rollout(2, workers=2)
    settings = LearnerSettings()
    rewards, values = lived["rewards"], lived["values"]
    expected, following = np.zeros_like(rewards), np.zeros(2, np.float32)
    for place in range(len(rewards) - 2, -1, -1):
        goes_on = 1.0 - lived["episode_starts"][place + 1]
        surprise = rewards[place] + settings.discount * values[place + 1] * goes_on - values[place]
        if place == len(rewards) - 2:
            following = lived["advantages"][-1]
        following = surprise + settings.discount * settings.gae_lambda * goes_on * following
        expected[place] = following
    np.testing.assert_allclose(lived["advantages"][:-1], expected[:-1], rtol=0, atol=1e-4)


def test_after_a_stop_in_the_middle_it_begins_again() -> None:
    settings = LearnerSettings(steps_per_robot=16, batch=16, epochs=1, memory_units=8)
    with TaskVecEnv(2, 3, "ideal", "1", ROOMS, workers=1) as environment:
        learner = make_learner(environment, settings, seed=0, critic=TASK.critic)
        learner.collection = Collection(environment)
        learner.learn(320, callback=Sums(stop_after=5))
        assert learner.num_timesteps == 10
        learner.learn(32, reset_num_timesteps=False)
        assert learner.rollout_buffer.full
        assert learner.rollout_buffer.forgot[0].all(), "nobody remembers what was before"


@pytest.mark.parametrize("robots", [1, 3])
def test_any_number_of_robots(robots: int) -> None:
    settings = LearnerSettings(steps_per_robot=8, batch=8, epochs=1, memory_units=0)
    with TaskVecEnv(robots, 3, "ideal", "1", ROOMS, workers=2) as environment:
        learner = make_learner(environment, settings, seed=0, critic=TASK.critic)
        learner.collection = Collection(environment)
        learner.learn(8 * robots)
        assert (learner.rollout_buffer.observations.std(axis=(2, 3, 4)) > 0).all()
