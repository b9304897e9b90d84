"""The policy that learns, where it drives: a copy of it in each worker, for whole stretches.

Nobody waits for anybody at a decision. Chance is drawn by who collects and handed over with the
task, so that a seed gives the same run whoever is faster, and checkpoints keep the generator.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from mbot_protocol.drive.picture import Picture
from mbot_workstation.learn.learning.full_speed import within_full_speed
from mbot_workstation.learn.learning.memory_policy import ACTIONS, Before, MemoryPolicy

FloatArray = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """What a pilot is told about a stretch.

    Attributes:
        weights: the policy's from now on; None leaves them.
        noise: standard normal, shape (decisions, n, 2).
        forgets: who begins anew after each decision, shape (decisions, n), as after an episode.

    """

    weights: dict[str, NDArray[Any]] | None
    noise: FloatArray
    forgets: NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Mind:
    """What n robots go by besides their pictures.

    Attributes:
        state: what each remembers, shape (n, units).
        told: what its wheels were told in the decision before, shape (n, 2).
        forgot: whether it begins anew, shape (n,).

    """

    state: FloatArray
    told: FloatArray
    forgot: NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Notes:
    """What was decided in a stretch; shapes (decisions, n, ...).

    Attributes:
        states, previous_actions, forgot: as the robots' minds were before each decision.
        actions: drawn, not clipped.
        told: to the wheels.
        known: what the actions were made of, (decisions, n, features + units).
        after: how the robots' minds are now.

    """

    states: FloatArray
    previous_actions: FloatArray
    forgot: NDArray[np.bool_]
    actions: FloatArray
    told: FloatArray
    known: FloatArray
    after: Mind

    @classmethod
    def together(cls, parts: Sequence["Notes"]) -> "Notes":
        """Of several workers, one beside the other."""
        names = [field.name for field in fields(cls) if field.name != "after"]
        return cls(
            **{name: np.concatenate([getattr(one, name) for one in parts], 1) for name in names},
            after=Mind(
                **{
                    field.name: np.concatenate([getattr(one.after, field.name) for one in parts])
                    for field in fields(Mind)
                }
            ),
        )


class PolicyPilot:
    """Drives a worker's robots by a policy with the weights that it is told; see `Pilot`."""

    def __init__(self, policy: MemoryPolicy) -> None:
        """A pilot as this policy is, but for its weights; these come with the first task."""
        self._kind = type(policy)
        self._arguments = policy.arguments()
        self._policy: MemoryPolicy | None = None
        self._decision = 0

    def start(self, task: Task) -> None:
        """Begin a stretch; what the robots remember goes on."""
        decisions, robots = task.forgets.shape
        if self._policy is None:
            torch.set_num_threads(1)  # a worker has one core
            self._policy = policy = self._kind(**self._arguments)
            policy.set_training_mode(False)
            self._state = torch.zeros(robots, policy.units)
            self._told = torch.zeros(robots, ACTIONS)
            self._forgot = np.ones(robots, np.bool_)
        policy = self._policy
        if task.weights is not None:
            policy.load_state_dict({n: torch.from_numpy(w) for n, w in task.weights.items()})
        self._noise, self._forgets, self._decision = torch.from_numpy(task.noise), task.forgets, 0
        shape = (decisions, robots)
        self._states = np.empty((*shape, policy.units), np.float32)
        self._before, self._actions, self._wheels = (
            np.empty((*shape, ACTIONS), np.float32) for _ in range(3)
        )
        self._anew = np.empty(shape, np.bool_)
        self._known = np.empty((*shape, policy.action_net.in_features), np.float32)

    @torch.inference_mode()
    def decide(self, pictures: Picture) -> FloatArray:
        """What the wheels of all robots are told, shape (n, 2)."""
        assert self._policy is not None
        now = self._decision
        self._states[now], self._before[now] = self._state.numpy(), self._told.numpy()
        self._anew[now] = self._forgot
        before = Before(torch.from_numpy(pictures), self._state, self._told)
        decided = self._policy.decide(before, self._noise[now])
        self._state, self._told = decided.state, within_full_speed(decided.actions)
        told = self._told.numpy()
        self._actions[now], self._known[now] = decided.actions.numpy(), decided.known.numpy()
        self._wheels[now] = told
        return told

    @torch.inference_mode()
    def arrive(self, ended: NDArray[np.bool_]) -> None:
        """Whose episodes ended remembers nothing."""
        self._forgot = ended | self._forgets[self._decision]
        self._decision += 1
        if self._forgot.any():
            keep = torch.from_numpy(~self._forgot).float().unsqueeze(1)
            self._state, self._told = self._state * keep, self._told * keep

    def notes(self) -> Notes:
        """Of the whole stretch."""
        return Notes(
            states=self._states,
            previous_actions=self._before,
            forgot=self._anew,
            actions=self._actions,
            told=self._wheels,
            known=self._known,
            after=Mind(self._state.numpy(), self._told.numpy(), self._forgot),
        )
