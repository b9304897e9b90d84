"""The paper's network with a memory behind it: what is learned, as SB3 wants it.

    picture -> PaperNetwork ---------------------+-> wheels
                    |                            |
                    +-> GRU (with the last action, from decision to decision) -> value

The memory tells what one picture cannot: whether the last turn turned as far as it should, so how
strong the motors are, how the floor grips and how late the picture is. The value is only needed in
training, and is told the truth: where the object is and what the robot is like.
"""

import itertools
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.policies import ActorCriticPolicy
from torch import nn
from torch.distributions import Normal

from mbot_workstation.training.learning.network import DENSE_UNITS, policy_arguments
from mbot_workstation.training.worlds.robot_body import BODY

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

_SITUATION = ("target_ahead_m", "target_left_m", "seen_left_rad", "time_left_s", "touches")
_SITUATION_SCALE = np.array([0.5, 0.5, 0.3, 0.02, 0.1], np.float32)

TRUTH = len(BODY) + len(_SITUATION)
"""Numbers that the critic is told beside what the policy knows."""

CRITIC_UNITS = 128


def truth(situations: NDArray[np.void], bodies: NDArray[np.void]) -> NDArray[np.float32]:
    """What the critic may know, shape (n, TRUTH), about 1 in size.

    Args:
        situations: STEP_RECORD, shape (n,).
        bodies: BODY_RECORD, shape (n,).

    """
    where = np.stack([situations[name] for name in _SITUATION], axis=1) * _SITUATION_SCALE
    what = np.stack([bodies[name] for name in BODY], axis=1) * _BODY_SCALE
    return np.nan_to_num(np.concatenate([where, what], axis=1)).astype(np.float32)


class MemoryPolicy(ActorCriticPolicy):
    """SB3's policy with a memory that runs along while a rollout is collected.

    `forward` decides for the running robots and keeps what it would remember; `drove` makes that
    the memory. Updates use `unroll` on stored sequences and leave the running memory alone.

    Attributes:
        memory: GRU from features and the last action; None for a policy without memory.
        state: what each running robot remembers, shape (robots, units).
        previous_action: of each, as the wheels were told, shape (robots, 2).
        truth: what the critic is told of each, shape (robots, TRUTH).

    """

    memory: nn.GRUCell | None

    def __init__(self, *args: Any, memory_units: int = MEMORY_UNITS, **kwargs: Any) -> None:
        self._units = memory_units
        super().__init__(*args, **kwargs)
        self.begin(1)

    @property
    def units(self) -> int:
        """How many numbers a robot remembers."""
        return self._units

    def begin(self, robots: int) -> None:
        """Forget everything, for so many robots."""
        self.state = torch.zeros(robots, self._units, device=self.device)
        self.previous_action = torch.zeros(robots, ACTIONS, device=self.device)
        self.truth = torch.zeros(robots, TRUTH, device=self.device)
        self._next_state = self.state

    def forward(
        self, obs: torch.Tensor, deterministic: bool = False
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Actions, values and log-probabilities for the running robots' pictures."""
        known = self._recall(obs)
        wheels = Normal(self.action_net(known), self.log_std.exp(), validate_args=False)
        actions = wheels.mean if deterministic else wheels.sample()
        return actions, self._value(known, self.truth), wheels.log_prob(actions).sum(dim=1)

    def _predict(self, observation: Any, deterministic: bool = False) -> torch.Tensor:
        return self(observation, deterministic)[0]

    def predict_values(self, obs: Any) -> torch.Tensor:
        """Values of the running robots' pictures; nothing is remembered of it."""
        return self._value(self._recall(obs), self.truth)

    def drove(self, actions: NDArray[np.float32], forget: NDArray[np.bool_]) -> None:
        """After a decision: what the wheels were told, and which robots begin anew."""
        keep = torch.from_numpy(~forget).to(self.device).float().unsqueeze(1)
        self.state = self._next_state * keep
        self.previous_action = torch.from_numpy(actions).to(self.device) * keep

    def unroll(
        self,
        pictures: torch.Tensor,
        previous_actions: torch.Tensor,
        forgot: torch.Tensor,
        state: torch.Tensor,
    ) -> torch.Tensor:
        """What the policy knows in every decision of some sequences.

        Args:
            pictures: shape (length, n, 64, 64, 3), uint8.
            previous_actions: shape (length, n, 2).
            forgot: shape (length, n), 1.0 where the memory begins anew before a decision.
            state: before the first decision, shape (n, units).

        Returns:
            Shape (length * n, features + units).

        """
        length, n = forgot.shape
        features = self._features(pictures.flatten(0, 1))
        if self.memory is None:
            return features
        inputs = torch.cat([features, previous_actions.flatten(0, 1)], dim=1).unflatten(
            0, (length, n)
        )
        cell = self.memory
        weights = (cell.weight_ih, cell.weight_hh, cell.bias_ih, cell.bias_hh)
        # From one forgetting to the next in one call: a call a decision costs as much as all the
        # convolutions, and holds Python's lock, which the other thread waits for (measured).
        cuts = torch.nonzero(forgot.any(dim=1)).flatten().tolist()
        states: list[torch.Tensor] = []
        for begin, end in itertools.pairwise(sorted({0, *cuts, length})):
            state = state * (1.0 - forgot[begin]).unsqueeze(1)
            seen, state = torch.gru(
                inputs[begin:end], state[None], weights, True, 1, 0.0, True, False, False
            )
            state = state[0]
            states.append(seen)
        return torch.cat([features, torch.cat(states).flatten(0, 1)], dim=1)

    def value_of(self, known: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
        """Values, shape (n,), of what is known, shape (n, features + units), and the truth."""
        return self._value(known, truth).flatten()

    def _recall(self, pictures: torch.Tensor) -> torch.Tensor:
        features = self._features(pictures)
        if self.memory is None:
            return features
        self._next_state = self.memory(
            torch.cat([features, self.previous_action], dim=1), self.state
        )
        return torch.cat([features, self._next_state], dim=1)

    def _features(self, pictures: torch.Tensor) -> torch.Tensor:
        return self.features_extractor(pictures.float())

    def _value(self, known: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
        return self.value_net(torch.cat([known, truth], dim=1))

    def _build(self, lr_schedule: Any) -> None:
        super()._build(lr_schedule)
        known = DENSE_UNITS + self._units
        self.memory = nn.GRUCell(DENSE_UNITS + ACTIONS, self._units) if self._units else None
        self.action_net = nn.Linear(known, ACTIONS)
        nn.init.orthogonal_(self.action_net.weight, gain=0.01)
        nn.init.zeros_(self.action_net.bias)
        self.value_net = nn.Sequential(
            nn.Linear(known + TRUTH, CRITIC_UNITS), nn.Tanh(), nn.Linear(CRITIC_UNITS, 1)
        )
        options: dict[str, Any] = {"lr": lr_schedule(1), **self.optimizer_kwargs}
        self.optimizer = self.optimizer_class(self.parameters(), **options)

    def _get_constructor_parameters(self) -> dict[str, Any]:
        return {**super()._get_constructor_parameters(), "memory_units": self._units}


def memory_policy_arguments(units: int, initial_log_std: float) -> dict[str, Any]:
    """What SB3 needs to make a `MemoryPolicy` of the paper's network."""
    return {**policy_arguments(initial_log_std), "memory_units": units}
