"""The paper's network with a memory behind it: what is learned, as SB3 wants it.

    picture -> network ----------------------------+-> wheels
                    |                            |
                    +-> GRU (with the last action, from decision to decision) -> value

The memory tells what one picture cannot: whether the last turn turned as far as it should, so how
strong the motors are, how the floor grips and how late the picture is. The value is only needed in
training, and is told the truth: how the task stands and what the robot is like.
"""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.policies import ActorCriticPolicy
from torch import nn
from torch.distributions import Normal

from mbot_workstation.learn.learning.full_speed import KEEPS_TURNS
from mbot_workstation.learn.learning.network import (
    DENSE_UNITS,
    PAPER_FILTER_PX,
    policy_arguments,
)
from mbot_workstation.learn.learning.residual_network import ResidualNetwork
from mbot_workstation.sim.effects.body_record import BODY

MEMORY_UNITS = 128

ACTIONS = 2

_BODY_SCALE = np.array(
    [
        {"dead_band": 0.02, "dead_band_compensation": 0.02}.get(
            name, 0.01 if name.endswith("_ms") else 1.0
        )
        for name in BODY
    ],
    np.float32,
)
"""Brings a body's numbers near 1."""

CRITIC_UNITS = 128


def critic_inputs(critic: Mapping[str, float]) -> int:
    """How many numbers the critic is told beside what the policy knows."""
    return len(critic) + len(BODY)


def truth(
    critic: Mapping[str, float], situations: NDArray[np.void], bodies: NDArray[np.void]
) -> NDArray[np.float32]:
    """What the critic may know, shape (n, critic_inputs), about 1 in size.

    Args:
        critic: the task's: names of facts, and what brings each near 1.
        situations: step records, shape (n,).
        bodies: BODY_RECORD, shape (n,).

    """
    scale = np.array(list(critic.values()), np.float32)
    where = np.stack([situations[name] for name in critic], axis=1) * scale
    what = np.stack([bodies[name] for name in BODY], axis=1) * _BODY_SCALE
    return np.nan_to_num(np.concatenate([where, what], axis=1)).astype(np.float32)


@dataclass(frozen=True, slots=True, eq=False)
class PolicyInput:
    """What n robots go by in a decision.

    Attributes:
        pictures: uint8, shape (n, 64, 64, 3).
        state: what each remembers, shape (n, units).
        previous_actions: as the wheels were told, shape (n, 2).

    """

    pictures: torch.Tensor
    state: torch.Tensor
    previous_actions: torch.Tensor


@dataclass(frozen=True, slots=True, eq=False)
class PolicyOutput:
    """What was made of it.

    Attributes:
        actions: not clipped, shape (n, 2).
        known: what they were made of, shape (n, features + units).
        state: what is remembered from now on, shape (n, units).

    """

    actions: torch.Tensor
    known: torch.Tensor
    state: torch.Tensor


@dataclass(frozen=True, slots=True, eq=False)
class Evaluated:
    """What is to be said of n decisions.

    Attributes:
        values: what was to be expected, shape (n,).
        log_probs: how likely the actions were, shape (n,).

    """

    values: torch.Tensor
    log_probs: torch.Tensor


class MemoryPolicy(ActorCriticPolicy):
    """SB3's policy with a memory; who collects decisions keeps what the robots remember.

    Attributes:
        memory: GRU from features and the last action; None for a policy without memory.
        critic_inputs: how many numbers the critic is told.
        keeps_turns: not a number to learn: it marks weights whose wheels are brought within bounds
            by `within_full_speed`; those of before have each wheel clipped by itself.

    """

    memory: nn.GRUCell | None
    keeps_turns: torch.Tensor

    def __init__(
        self, *args: Any, memory_units: int = MEMORY_UNITS, critic_inputs: int, **kwargs: Any
    ) -> None:
        self._units, self.critic_inputs = memory_units, critic_inputs
        super().__init__(*args, **kwargs)

    @property
    def units(self) -> int:
        """How many numbers a robot remembers."""
        return self._units

    @property
    def learned(self) -> list[nn.Parameter]:
        """What is still learned."""
        return [parameter for parameter in self.parameters() if parameter.requires_grad]

    @property
    def has_learned_to_see(self) -> bool:
        """Whether the layers in front of the memory learn no more."""
        return not any(one.requires_grad for one in self.features_extractor.parameters())

    def begin_with(self, advice: nn.Linear) -> None:
        """Decide as this layer, from features to wheels, whatever is remembered."""
        with torch.no_grad():
            self.action_net.weight.zero_()
            self.action_net.weight[:, :DENSE_UNITS].copy_(advice.weight)
            self.action_net.bias.copy_(advice.bias)

    def keep_eye(self) -> None:
        """Learn no more to see: from now on only what follows the features."""
        self.features_extractor.requires_grad_(False)
        self.features_extractor.zero_grad()  # an optimiser would follow what is left there

    def decide(self, inputs: PolicyInput, noise: torch.Tensor | None = None) -> PolicyOutput:
        """One decision of some robots; with noise, standard normal of shape (n, 2), it explores."""
        known, state = self._recall(inputs)
        mean = self.action_net(known)
        actions = mean if noise is None else mean + self.log_std.exp() * noise
        return PolicyOutput(actions, known, state)

    def judge(self, known: torch.Tensor, actions: torch.Tensor, truth: torch.Tensor) -> Evaluated:
        """Of decisions that were made; for many at once it costs little."""
        wheels = Normal(self.action_net(known), self.log_std.exp(), validate_args=False)
        return Evaluated(self.value_of(known, truth), wheels.log_prob(actions).sum(dim=1))

    def forward(
        self, obs: torch.Tensor, deterministic: bool = False
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """What SB3 asks for: as `decide`, for robots that remember nothing, without the truth."""
        state, previous, truth = (
            torch.zeros(len(obs), n, device=obs.device)
            for n in (self._units, ACTIONS, self.critic_inputs)
        )
        noise = None if deterministic else torch.randn(len(obs), ACTIONS).to(obs.device)
        decided = self.decide(PolicyInput(obs, state, previous), noise)
        judged = self.judge(decided.known, decided.actions, truth)
        return decided.actions, judged.values, judged.log_probs

    def _predict(self, observation: Any, deterministic: bool = False) -> torch.Tensor:
        return self(observation, deterministic)[0]

    def predict_values(self, obs: Any) -> torch.Tensor:
        """Likewise."""
        return self(obs)[1]

    def unroll(
        self,
        seen: torch.Tensor,
        previous_actions: torch.Tensor,
        forgot: torch.Tensor,
        state: torch.Tensor,
        short: bool = False,
    ) -> torch.Tensor:
        """What the policy knows in every decision of some sequences.

        Args:
            seen: pictures, shape (length, n, 64, 64, 3), uint8, or their features, shape
                (length, n, features), float32.
            previous_actions: shape (length, n, 2).
            forgot: shape (length, n), 1.0 where the memory begins anew before a decision.
            state: before the first decision, shape (n, units).
            short: features from bfloat16, within 1 % of what they are.

        Returns:
            Shape (length * n, features + units).

        """
        length, n = forgot.shape
        features = seen.flatten(0, 1)
        if features.ndim > 2:
            with torch.autocast(seen.device.type, torch.bfloat16, enabled=short):
                features = self._features(features, short).float()
        if not self._units:
            return features
        met = torch.cat([features, previous_actions.flatten(0, 1)], dim=1)
        recalled = self._recall_all(met.unflatten(0, (length, n)), forgot, state)
        return torch.cat([features, recalled], dim=1)

    def _recall_all(
        self, met: torch.Tensor, forgot: torch.Tensor, state: torch.Tensor
    ) -> torch.Tensor:
        """What is recalled in every decision of some sequences, shape (length * n, units).

        Args:
            met: features and the action before, shape (length, n, features + 2).
            forgot, state: as for `unroll`.

        """
        cell = self.memory
        assert cell is not None
        weights = (cell.weight_ih, cell.weight_hh, cell.bias_ih, cell.bias_hh)
        # From one forgetting to the next in one call: a call a decision costs as much as all the
        # convolutions, and holds Python's lock, which the other thread waits for (measured).
        cuts = torch.nonzero(forgot.any(dim=1)).flatten().tolist()
        states: list[torch.Tensor] = []
        for begin, end in itertools.pairwise(sorted({0, *cuts, len(met)})):
            state = state * (1.0 - forgot[begin]).unsqueeze(1)
            seen, state = torch.gru(
                met[begin:end], state[None], weights, True, 1, 0.0, True, False, False
            )
            state = state[0]
            states.append(seen)
        return torch.cat(states).flatten(0, 1)

    def value_of(self, known: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
        """Values, shape (n,), of what is known, shape (n, features + units), and the truth."""
        return self.value_net(torch.cat([known, truth], dim=1)).flatten()

    def _recall(self, inputs: PolicyInput) -> tuple[torch.Tensor, torch.Tensor]:
        """What is known in a decision, and what is remembered of it."""
        features = self._features(inputs.pictures)
        if self.memory is None:
            return features, inputs.state
        state = self.memory(torch.cat([features, inputs.previous_actions], dim=1), inputs.state)
        return torch.cat([features, state], dim=1), state

    def _features(self, pictures: torch.Tensor, short: bool = False) -> torch.Tensor:
        return self.features_extractor(pictures.to(torch.bfloat16 if short else torch.float32))

    def _build(self, lr_schedule: Any) -> None:
        super()._build(lr_schedule)
        known = DENSE_UNITS + self._units
        self.memory = nn.GRUCell(DENSE_UNITS + ACTIONS, self._units) if self._units else None
        self.register_buffer(KEEPS_TURNS, torch.ones(()))
        self.action_net = nn.Linear(known, ACTIONS)
        nn.init.orthogonal_(self.action_net.weight, gain=0.01)
        nn.init.zeros_(self.action_net.bias)
        self.value_net = nn.Sequential(
            nn.Linear(known + self.critic_inputs, CRITIC_UNITS),
            nn.Tanh(),
            nn.Linear(CRITIC_UNITS, 1),
        )
        options: dict[str, Any] = {"lr": lr_schedule(1), **self.optimizer_kwargs}
        self.optimizer = self.optimizer_class(self.parameters(), **options)

    def arguments(self) -> dict[str, Any]:
        """What makes another one of the same shape, to drive and not to learn; can be pickled."""
        return {**self._get_constructor_parameters(), "lr_schedule": _learns_nothing}

    def _get_constructor_parameters(self) -> dict[str, Any]:
        own = {"memory_units": self._units, "critic_inputs": self.critic_inputs}
        return {**super()._get_constructor_parameters(), **own}


def _learns_nothing(remaining: float) -> float:
    del remaining
    return 0.0


def memory_policy_arguments(
    units: int,
    initial_log_std: float,
    critic_inputs: int,
    first_filter_px: int = PAPER_FILTER_PX,
    *,
    residual: bool = False,
) -> dict[str, Any]:
    """What SB3 needs to make a `MemoryPolicy`; without a memory it is the paper's, unless it is
    to be the residual network.
    """
    network = policy_arguments(initial_log_std, deeper=units > 0, first_filter_px=first_filter_px)
    if residual:
        network |= {"features_extractor_class": ResidualNetwork, "features_extractor_kwargs": {}}
    return {**network, "memory_units": units, "critic_inputs": critic_inputs}
