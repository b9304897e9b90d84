"""SB3's PPO with two things changed for pictures on a few processor cores.

Pictures are not transposed: PaperNetwork takes them as they are. And an update splits every batch
between Python threads that each use one core, instead of splitting every operation between torch's
threads: the network's operations last some 100 microseconds, so that waiting for each other after
every one costs more than it wins, by a factor of 8 when another program wants a core (measured).
What is computed is SB3's PPO update.
"""

import math
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.type_aliases import RolloutBufferSamples
from stable_baselines3.common.vec_env import VecEnv
from torch.distributions import Normal
from torch.nn import functional

from mbot_workstation.training.learning.advice_memory import AdviceMemory
from mbot_workstation.training.learning.guidance import (
    GuidedRolloutBuffer,
    GuidedSamples,
    advice_loss,
    guide_weight,
)

MEMORY_CAPACITY = 200_000
"""Pictures with advice; 2.4 GB when full."""


@dataclass(frozen=True, slots=True)
class _Part:
    """What one thread made of its part of a batch; sums over its samples, shapes ()."""

    gradients: tuple[torch.Tensor, ...]
    policy_loss: torch.Tensor
    value_loss: torch.Tensor
    divergence: torch.Tensor
    clipped: torch.Tensor


class PicturePPO(PPO):
    """PPO for pictures of shape (height, width, 3), updated by threads.

    Attributes:
        update_threads: into how many parts a batch is split. It changes results only by rounding,
            and does not depend on the machine, so that a seed gives the same run anywhere.
        noise_at: the exploration noise when this share of the planned decisions remains; None
            lets PPO learn it, as stable-baselines3 does.
        guided_decisions: for how many decisions a guide's advice counts, falling linearly; the
            rollout buffer must then be a GuidedRolloutBuffer.
        rehearsals: batches of remembered advice that every update learns from besides.
        rehearsal_batch: samples of each.

    """

    update_threads = 2
    noise_at: Callable[[float], float] | None = None
    guided_decisions = 0
    rehearsals = 0
    rehearsal_batch = 256

    rollout_buffer: RolloutBuffer
    _memory: AdviceMemory | None = None

    @staticmethod
    def _wrap_env(env: Any, verbose: int = 0, monitor_wrapper: bool = True) -> VecEnv:
        del verbose, monitor_wrapper
        return env

    def _excluded_save_params(self) -> list[str]:
        # The memory is gigabytes, and soon made anew; the schedule is the configuration's.
        return [*super()._excluded_save_params(), "_memory", "noise_at"]

    def train(self) -> None:
        """Learn from the rollout, as PPO.train; the losses go to the logger."""
        self.policy.set_training_mode(True)
        self._update_learning_rate(self.policy.optimizer)
        parts: list[_Part] = []
        with ThreadPoolExecutor(self.update_threads) as threads:
            for _ in range(self.n_epochs):
                for batch in self.rollout_buffer.get(self.batch_size):
                    parts += self._step(threads, batch)
                self._n_updates += 1
            if guide_weight(self.num_timesteps, self.guided_decisions) > 0:
                self._rehearse(threads)
        self._log(parts)

    def collect_rollouts(self, *args: Any, **options: Any) -> bool:
        """A rollout, as PPO's, that explores as much as is planned."""
        if self.noise_at is not None:
            noise = self.noise_at(1.0 - self.num_timesteps / self._total_timesteps)
            with torch.no_grad():
                self.policy.log_std.fill_(math.log(noise))
        return super().collect_rollouts(*args, **options)

    def _rehearse(self, threads: ThreadPoolExecutor) -> None:
        """Learn from advice alone, the newest and what is remembered."""
        buffer = self.rollout_buffer
        if not isinstance(buffer, GuidedRolloutBuffer) or self.rehearsals == 0:
            return
        if self._memory is None:
            self._memory = AdviceMemory(MEMORY_CAPACITY, buffer.obs_shape)
        self._memory.add(*buffer.flat_advice())
        parameters = list(self.policy.parameters())
        for _ in range(self.rehearsals):
            batch = self._memory.draw(self.rehearsal_batch)
            halves = zip(
                np.array_split(batch.pictures, self.update_threads),
                np.array_split(batch.advice, self.update_threads),
                strict=True,
            )
            for parameter, *gradients in zip(
                parameters, *threads.map(self._advice_gradients, halves), strict=True
            ):
                parameter.grad = torch.stack(gradients).sum(0) / self.rehearsal_batch
            torch.nn.utils.clip_grad_norm_(parameters, self.max_grad_norm)
            self.policy.optimizer.step()

    def _advice_gradients(self, part: tuple[Any, Any]) -> tuple[torch.Tensor, ...]:
        pictures, advice = (torch.from_numpy(field).to(self.device) for field in part)
        for_wheels, _ = self.policy.mlp_extractor(self.policy.extract_features(pictures.float()))
        loss = advice_loss(self.policy.action_net(for_wheels), advice)
        parameters = list(self.policy.parameters())
        # The value and the noise have no part in it: zeros.
        return torch.autograd.grad(loss, parameters, allow_unused=True, materialize_grads=True)

    def _step(self, threads: ThreadPoolExecutor, batch: RolloutBufferSamples) -> list[_Part]:
        """One gradient step."""
        parameters = list(self.policy.parameters())
        parts = list(threads.map(self._part, _split(batch, self.update_threads)))
        for parameter, *gradients in zip(
            parameters, *(part.gradients for part in parts), strict=True
        ):
            parameter.grad = torch.stack(gradients).sum(0) / len(batch.actions)
        torch.nn.utils.clip_grad_norm_(parameters, self.max_grad_norm)
        self.policy.optimizer.step()
        return parts

    def _part(self, batch: RolloutBufferSamples) -> _Part:
        """Losses and gradients of a part, its advantages normalised already."""
        # Not policy.evaluate_actions: it keeps the distribution in an attribute, which threads
        # would take from each other.
        features = self.policy.extract_features(batch.observations)
        for_wheels, for_value = self.policy.mlp_extractor(features)
        wheels = Normal(
            self.policy.action_net(for_wheels), self.policy.log_std.exp(), validate_args=False
        )
        values = self.policy.value_net(for_value)
        change = wheels.log_prob(batch.actions).sum(dim=1) - batch.old_log_prob
        ratio = torch.exp(change)
        reach: float = self.clip_range(self._current_progress_remaining)  # pyright: ignore[reportCallIssue, reportAssignmentType]
        bounded = torch.clamp(ratio, 1 - reach, 1 + reach)
        policy_loss = -torch.min(batch.advantages * ratio, batch.advantages * bounded).sum()
        value_loss = functional.mse_loss(values.flatten(), batch.returns, reduction="sum")
        loss = policy_loss + self.vf_coef * value_loss - self.ent_coef * wheels.entropy().sum()
        weight = guide_weight(self.num_timesteps, self.guided_decisions)
        if weight > 0 and isinstance(batch, GuidedSamples):
            loss = loss + weight * advice_loss(wheels.mean, batch.advice)
        gradients = torch.autograd.grad(loss, list(self.policy.parameters()))
        with torch.no_grad():
            return _Part(
                gradients,
                policy_loss.detach(),
                value_loss.detach(),
                divergence=(ratio - 1 - change).sum(),
                clipped=(torch.abs(ratio - 1) > reach).float().sum(),
            )

    def _log(self, parts: list[_Part]) -> None:
        samples = self.n_epochs * self.rollout_buffer.buffer_size * self.n_envs
        for name in ("policy_loss", "value_loss", "divergence", "clipped"):
            total = torch.stack([getattr(part, name) for part in parts]).sum()
            self.logger.record(f"train/{name}", float(total) / samples)
        self.logger.record("train/std", float(torch.exp(self.policy.log_std.detach()).mean()))


def _split(batch: RolloutBufferSamples, count: int) -> Iterator[RolloutBufferSamples]:
    """Parts of a batch of the same size as far as possible, with normalised advantages."""
    advantages = batch.advantages
    if len(advantages) > 1:
        advantages = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
    whole = batch._replace(advantages=advantages)
    size = -(-len(advantages) // count)
    for part in zip(*(torch.split(field, size) for field in whole), strict=True):
        yield type(batch)(*part)
