"""SB3's PPO with three things changed for pictures on a few processor cores, and one for memory.

Pictures are not transposed: PictureNetwork takes them as they are. An update splits every batch
between Python threads that each use one core, instead of splitting every operation between torch's
threads: the network's operations last some 100 microseconds, so that waiting for each other after
every one costs more than it wins, by a factor of 8 when another program wants a core (measured).
Decisions come from a `Collection`, which keeps all cores busy. And it learns from sequences,
through which the memory's gradient goes back. What is computed besides is SB3's PPO update.
"""

import math
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv
from torch.distributions import Normal
from torch.nn import functional

from mbot_workstation.learn.learning.advice_memory import AdviceMemory
from mbot_workstation.learn.learning.collection import Collection
from mbot_workstation.learn.learning.guidance import advice_loss, guide_weight
from mbot_workstation.learn.learning.hands_advice import as_seen
from mbot_workstation.learn.learning.memory_policy import MemoryPolicy
from mbot_workstation.learn.learning.network import DENSE_UNITS
from mbot_workstation.learn.learning.processor import has_short_floats
from mbot_workstation.learn.learning.sequences import (
    LearnedFrom,
    SequenceBuffer,
    Sequences,
    tensor,
)
from mbot_workstation.learn.learning.views import Stills

MEMORY_CAPACITY = 200_000
"""Decisions with advice; 2.4 GB when full."""

Batch = TypeVar("Batch", bound=Sequences)
Done = TypeVar("Done")

ALONE_EVERY, STILLS_EVERY = 8, 2
"""Of so many rehearsals one is of single pictures without a memory; of an eye that learns no more,
whose stills cost little, more of them (docs/notebook/training.md)."""


@dataclass(frozen=True, slots=True)
class _Part:
    """What one thread made of its part of a batch; sums over its samples, shapes ()."""

    gradients: tuple[torch.Tensor, ...]
    policy_loss: torch.Tensor
    value_loss: torch.Tensor
    divergence: torch.Tensor
    clipped: torch.Tensor


class PicturePPO(PPO):
    """PPO for pictures of shape (height, width, 3), updated by threads; its policy is a
    `MemoryPolicy`.

    Attributes:
        update_threads: into how many parts a batch is split; one on a GPU. It changes results only
            by rounding, and does not depend on how many cores there are. Features do depend on the
            processor: they are bfloat16 where it is faster at it, so that a seed gives another
            run there.
        collection: where rollouts come from; None is SB3's own loop, in which nothing is
            remembered.
        reward_scale: rewards are multiplied by it.
        noise_at: the exploration noise when this share of the planned decisions remains; None
            lets PPO learn it, as stable-baselines3 does.
        guided_decisions: for how many decisions a guide's advice counts, falling linearly.
        guided_epochs: in place of `n_epochs` while it counts for more than half; None is as many.
        rehearsals: batches of remembered advice that every update learns from besides.
        rehearsal_batch: decisions of each.
        stills: single pictures from anywhere, for an eye that learns no more; who has them
            rehearses them in place of single ones of what was driven.
        real: what hands did on recorded drives, as this policy sees it; rehearsed beside simulated
            sequences.
        real_share: of the sequences of a batch.

    """

    collection: Collection | None = None
    update_threads = 2
    reward_scale = 1.0
    noise_at: Callable[[float], float] | None = None
    guided_decisions = 0
    guided_epochs: int | None = None
    rehearsals = 0
    rehearsal_batch = 256
    stills: Stills | None = None
    real: Sequences | None = None
    real_share = 0.0

    policy: MemoryPolicy  # pyright: ignore[reportIncompatibleVariableOverride]
    rollout_buffer: SequenceBuffer  # pyright: ignore[reportIncompatibleVariableOverride]
    _memory: AdviceMemory | None = None

    @staticmethod
    def _wrap_env(env: Any, verbose: int = 0, monitor_wrapper: bool = True) -> VecEnv:
        del verbose, monitor_wrapper
        return env

    def _setup_model(self) -> None:
        super()._setup_model()
        if self.device.type != "cpu":
            self.update_threads = 1  # a GPU has threads enough, and one queue for all of ours
        self.rollout_buffer.units = self.policy.units
        self.rollout_buffer.critic_inputs = self.policy.critic_inputs
        self.rollout_buffer.reset()

    def keep_eye(self, stills: Stills | None) -> None:
        """Learn no more to see, but from what is seen: what pictures are to the eye is kept in
        their place.
        """
        self.policy.keep_eye()
        self.rollout_buffer.features = DENSE_UNITS
        self.rollout_buffer.reset()
        self.stills = stills

    def rehearse_beside(self, real: Sequences | None, share: float) -> None:
        """Rehearse what hands did, if any did; once it is settled whether the eye learns."""
        if real is not None and self.policy.has_learned_to_see:
            real = as_seen(real, self.policy.features_extractor)
        self.real, self.real_share = real, share

    def _excluded_save_params(self) -> list[str]:
        # The memory is gigabytes, and soon made anew; the schedule is the configuration's.
        return [
            *super()._excluded_save_params(),
            "_memory",
            "noise_at",
            "collection",
            "stills",
            "real",
        ]

    def train(self) -> None:
        """Learn from the rollout, as PPO.train; the losses go to the logger."""
        self.policy.set_training_mode(True)
        self._update_learning_rate(self.policy.optimizer)
        guided = guide_weight(self.num_timesteps, self.guided_decisions)
        epochs = self.n_epochs
        if guided > 0.5 and self.guided_epochs is not None:
            epochs = self.guided_epochs
        parts: list[_Part] = []
        with ThreadPoolExecutor(self.update_threads) as threads:
            batches = (
                _normalised(batch)
                for _ in range(epochs)
                for batch in self.rollout_buffer.sequences(self.batch_size)
            )
            for done, decisions in self._together(threads, self._part, batches):
                self._descend([part.gradients for part in done], decisions)
                parts += done
            self._n_updates += epochs
            if guided > 0 and self.rehearsals:
                self._rehearse(threads)
        self._log(parts, epochs)

    def _setup_learn(self, *args: Any, **options: Any) -> tuple[int, BaseCallback]:
        begun = super()._setup_learn(*args, **options)
        if self.collection is not None:
            self.collection.begin(self.policy)
        return begun

    def collect_rollouts(
        self,
        env: VecEnv,
        callback: BaseCallback,
        rollout_buffer: RolloutBuffer,
        n_rollout_steps: int,
    ) -> bool:
        """A rollout, as PPO's, that explores as much as is planned."""
        if self.noise_at is not None:
            noise = self.noise_at(1.0 - self.num_timesteps / self._total_timesteps)
            with torch.no_grad():
                self.policy.log_std.fill_(math.log(noise))
        if self.collection is None:
            return super().collect_rollouts(env, callback, rollout_buffer, n_rollout_steps)
        self.policy.set_training_mode(False)
        callback.on_rollout_start()

        def go_on(infos: list[dict[str, Any]]) -> bool:
            self.num_timesteps += env.num_envs
            self._update_info_buffer(infos)
            callback.update_locals({"infos": infos})
            return callback.on_step()

        whole = self.collection.fill(self.rollout_buffer, self.policy, self.reward_scale, go_on)
        if whole:
            callback.on_rollout_end()
        return whole

    def _rehearse(self, threads: ThreadPoolExecutor) -> None:
        """Learn from advice alone, the newest and what is remembered."""
        if self._memory is None:
            self._memory = AdviceMemory(MEMORY_CAPACITY)
        self._memory.add(self.rollout_buffer.everything())
        batches = map(self._rehearsal, range(self.rehearsals))
        for done, decisions in self._together(threads, self._advice_gradients, batches):
            self._descend(done, decisions)

    def _rehearsal(self, number: int) -> Sequences:
        assert self._memory is not None
        every = ALONE_EVERY if self.stills is None else STILLS_EVERY
        if self.policy.units == 0 or number % every:
            return self._sequences()
        alone = self._memory.draw_alone if self.stills is None else self.stills.draw
        return alone(self.rehearsal_batch)

    def _sequences(self) -> Sequences:
        """A batch with memory: of the simulation, and of drives if there are any."""
        assert self._memory is not None
        if self.real is None:
            return self._memory.draw(self.rehearsal_batch)
        length, there = self.real.forgot.shape
        real = max(1, round(self.real_share * self.rehearsal_batch / length))
        drawn = self.real.chosen(np.random.randint(there, size=real))
        simulated = self.rehearsal_batch - real * length
        return self._memory.draw(simulated).beside(drawn) if simulated > 0 else drawn

    def _together(
        self,
        threads: ThreadPoolExecutor,
        work: Callable[[Batch], Done],
        batches: Iterator[Batch],
    ) -> Iterator[tuple[list[Done], int]]:
        """What all threads make of each batch, and its size; the next is drawn meanwhile."""
        following = next(batches, None)
        while (batch := following) is not None:
            parts = [batch.part(index, self.update_threads) for index in range(self.update_threads)]
            under_way = [threads.submit(work, part) for part in parts if part.decisions]
            following = next(batches, None)
            yield [one.result() for one in under_way], batch.decisions

    def _advice_gradients(self, part: Sequences) -> tuple[torch.Tensor, ...]:
        wheels = self.policy.action_net(self._known(part))
        loss = advice_loss(wheels, tensor(part.advice, self.device).flatten(0, 1))
        parameters = self.policy.learned
        # The value and the noise have no part in it: zeros.
        return torch.autograd.grad(loss, parameters, allow_unused=True, materialize_grads=True)

    def _known(self, part: Sequences) -> torch.Tensor:
        # Robots drive with whole floats: PPO's ratio is off by 0.01 RMS before anything is learned,
        # where it is bounded at 0.2 (measured; test_processor.py holds it to 0.02).
        short = has_short_floats(self.device)
        fields = (part.seen, part.previous_actions, part.forgot, part.state)
        return self.policy.unroll(*(tensor(field, self.device) for field in fields), short=short)

    def _descend(self, gradients: list[tuple[torch.Tensor, ...]], samples: int) -> None:
        """One step of the optimiser by the sum of several parts' gradients over all samples."""
        parameters = self.policy.learned
        for parameter, first, *others in zip(parameters, *gradients, strict=True):
            # In the parameter's order of memory: some come with channels last, and the fused
            # optimiser takes numbers as they lie.
            gradient = torch.empty_like(parameter).copy_(first)
            for other in others:
                gradient += other
            parameter.grad = gradient.div_(samples)
        torch.nn.utils.clip_grad_norm_(parameters, self.max_grad_norm)
        self.policy.optimizer.step()

    def _part(self, batch: LearnedFrom) -> _Part:
        """Losses and gradients of a part, its advantages normalised already."""
        known = self._known(batch)
        actions, truth, advice = (
            tensor(field, self.device).flatten(0, 1)
            for field in (batch.actions, batch.truth, batch.advice)
        )
        old_log_prob, advantages, returns = (
            tensor(field, self.device).flatten()
            for field in (batch.old_log_prob, batch.advantages, batch.returns)
        )
        wheels = Normal(
            self.policy.action_net(known), self.policy.log_std.exp(), validate_args=False
        )
        values = self.policy.value_of(known, truth)
        change = wheels.log_prob(actions).sum(dim=1) - old_log_prob
        ratio = torch.exp(change)
        reach: float = self.clip_range(self._current_progress_remaining)  # pyright: ignore[reportCallIssue, reportAssignmentType]
        bounded = torch.clamp(ratio, 1 - reach, 1 + reach)
        policy_loss = -torch.min(advantages * ratio, advantages * bounded).sum()
        value_loss = functional.mse_loss(values, returns, reduction="sum")
        loss = policy_loss + self.vf_coef * value_loss - self.ent_coef * wheels.entropy().sum()
        weight = guide_weight(self.num_timesteps, self.guided_decisions)
        if weight > 0:
            loss = loss + weight * advice_loss(wheels.mean, advice)
        gradients = torch.autograd.grad(loss, self.policy.learned)
        with torch.no_grad():
            return _Part(
                gradients,
                policy_loss.detach(),
                value_loss.detach(),
                divergence=(ratio - 1 - change).sum(),
                clipped=(torch.abs(ratio - 1) > reach).float().sum(),
            )

    def _log(self, parts: list[_Part], epochs: int) -> None:
        samples = epochs * self.rollout_buffer.buffer_size * self.n_envs
        for name in ("policy_loss", "value_loss", "divergence", "clipped"):
            total = torch.stack([getattr(part, name) for part in parts]).sum()
            self.logger.record(f"train/{name}", float(total) / samples)
        self.logger.record("train/std", float(torch.exp(self.policy.log_std.detach()).mean()))


def _normalised(batch: LearnedFrom) -> LearnedFrom:
    """With advantages of mean 0 and deviation 1, as SB3's PPO."""
    advantages = batch.advantages
    if advantages.size > 1:
        advantages = (advantages - advantages.mean()) / (advantages.std(ddof=1) + 1e-8)
    return replace(batch, advantages=advantages)
