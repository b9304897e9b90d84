"""What robots lived through, cut into sequences that a memory can be trained on."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.buffers import RolloutBuffer

from mbot_workstation.learn.learning.memory_policy import ACTIONS

LENGTH = 32
"""Decisions of a sequence, 13 s: what a memory learns to keep reaches as far back."""


@dataclass(frozen=True, slots=True, eq=False)
class Sequences:
    """Some sequences side by side; every field but `state` has shape (length, n, ...).

    Attributes:
        seen: pictures, (length, n, 64, 64, 3), uint8; or what an eye that learns no more makes of
            them, (length, n, features), float32.
        previous_actions: (length, n, 2), as the wheels were told.
        forgot: (length, n), float32; 1 where the memory began anew before the decision.
        state: (n, units), before the first decision.
        advice: (length, n, 2); NaN where there is none.
        shows: (length, n), bool; whether the picture shows the object.

    """

    seen: NDArray[np.uint8] | NDArray[np.float32]
    previous_actions: NDArray[np.float32]
    forgot: NDArray[np.float32]
    state: NDArray[np.float32]
    advice: NDArray[np.float32]
    shows: NDArray[np.bool_]

    def part(self, index: int, count: int) -> "Sequences":
        """One of `count` parts, side by side."""
        return type(self)(
            **{
                field.name: np.array_split(
                    getattr(self, field.name), count, axis=0 if field.name == "state" else 1
                )[index]
                for field in fields(self)
            }
        )

    def chosen(self, columns: NDArray[np.int64]) -> "Sequences":
        """These of them, as often as they are named."""
        made = {
            field.name: np.take(
                getattr(self, field.name), columns, axis=0 if field.name == "state" else 1
            )
            for field in fields(Sequences)
        }
        return Sequences(**made)

    def beside(self, others: "Sequences") -> "Sequences":
        """These and others of the same length."""
        made = {
            field.name: np.concatenate(
                [getattr(one, field.name) for one in (self, others)],
                axis=0 if field.name == "state" else 1,
            )
            for field in fields(Sequences)
        }
        return Sequences(**made)

    @property
    def decisions(self) -> int:
        """How many there are."""
        return self.forgot.size


@dataclass(frozen=True, slots=True, eq=False)
class LearnedFrom(Sequences):
    """Sequences with all that PPO wants to know; shapes (length, n) but for the first two.

    Attributes:
        actions: (length, n, 2), as drawn, not clipped.
        truth: (length, n, critic_inputs), for the critic.
        old_log_prob, old_values, advantages, returns: as SB3 has them.

    """

    actions: NDArray[np.float32]
    truth: NDArray[np.float32]
    old_log_prob: NDArray[np.float32]
    old_values: NDArray[np.float32]
    advantages: NDArray[np.float32]
    returns: NDArray[np.float32]


class SequenceBuffer(RolloutBuffer):
    """SB3's rollout buffer, with what a memory and a guide add.

    Attributes:
        features: how many numbers an eye that learns no more makes of a picture; 0 keeps pictures.
        states: before each decision, shape (steps, robots, units).
        previous_actions: shape (steps, robots, 2).
        forgot: shape (steps, robots), whether the state is a new one.
        truth: shape (steps, robots, critic_inputs).
        advice: shape (steps, robots, 2).
        shows: shape (steps, robots), whether the picture shows the object.

    """

    units = 0
    critic_inputs = 0
    features = 0

    def reset(self) -> None:
        """Empty it."""
        super().reset()
        shape = (self.buffer_size, self.n_envs)
        if self.features:
            self.observations = np.zeros((*shape, self.features), np.float32)
        self.states = np.zeros((*shape, self.units), np.float32)
        self.previous_actions = np.zeros((*shape, ACTIONS), np.float32)
        self.forgot = np.zeros(shape, np.float32)
        self.truth = np.zeros((*shape, self.critic_inputs), np.float32)
        self.advice = np.full((*shape, ACTIONS), np.nan, np.float32)
        self.shows = np.zeros(shape, np.bool_)

    @property
    def length(self) -> int:
        """Of the sequences that it is cut into."""
        return math.gcd(self.buffer_size, LENGTH)

    def sequences(self, decisions: int) -> Iterator[LearnedFrom]:
        """All of it once, in batches of about so many decisions, in random order."""
        segments = self.buffer_size // self.length
        order = np.random.permutation(segments * self.n_envs)
        size = max(1, decisions // self.length)
        for start in range(0, len(order), size):
            segment, robot = np.divmod(order[start : start + size], self.n_envs)
            yield self._cut(segment * self.length, robot)

    def everything(self) -> LearnedFrom:
        """All of it at once, in its order."""
        segments = self.buffer_size // self.length
        segment, robot = np.divmod(np.arange(segments * self.n_envs), self.n_envs)
        return self._cut(segment * self.length, robot)

    def _cut(self, begin: NDArray[np.int64], robot: NDArray[np.int64]) -> LearnedFrom:
        moments = begin[None, :] + np.arange(self.length)[:, None]
        return LearnedFrom(
            seen=self.observations[moments, robot],
            previous_actions=self.previous_actions[moments, robot],
            forgot=self.forgot[moments, robot],
            state=self.states[begin, robot],
            advice=self.advice[moments, robot],
            shows=self.shows[moments, robot],
            actions=self.actions[moments, robot],
            truth=self.truth[moments, robot],
            old_log_prob=self.log_probs[moments, robot],
            old_values=self.values[moments, robot],
            advantages=self.advantages[moments, robot],
            returns=self.returns[moments, robot],
        )


def tensor(values: NDArray[np.generic], device: torch.device) -> torch.Tensor:
    """An array where the network is, of the same shape and type."""
    return torch.from_numpy(np.ascontiguousarray(values)).to(device)
