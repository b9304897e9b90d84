"""The policy that learns, where it drives: a copy of it in each worker, for whole segments."""

import numpy as np
import torch
from numpy.typing import NDArray

from mbot_protocol.drive.picture import Picture
from mbot_workstation.learn.learning.full_speed import within_full_speed
from mbot_workstation.learn.learning.memory_policy import ACTIONS, MemoryPolicy, PolicyInput
from mbot_workstation.learn.worlds.segment import (
    Decisions,
    FloatArray,
    HiddenState,
    SegmentPlan,
)


class PolicyPilot:
    """Drives a worker's robots by a policy with the weights that it is told; see `Pilot`."""

    def __init__(self, policy: MemoryPolicy) -> None:
        """A pilot as this policy is, but for its weights; these come with the first plan."""
        self._kind = type(policy)
        self._arguments = policy.arguments()
        self._policy: MemoryPolicy | None = None
        self._decision = 0

    def start(self, plan: SegmentPlan) -> None:
        """Begin a segment; what the robots remember goes on."""
        decisions, robots = plan.forgets.shape
        if self._policy is None:
            torch.set_num_threads(1)  # a worker has one core
            self._policy = policy = self._kind(**self._arguments)
            policy.set_training_mode(False)
            self._state = torch.zeros(robots, policy.units)
            self._previous = torch.zeros(robots, ACTIONS)
            self._forgot = np.ones(robots, np.bool_)
        policy = self._policy
        if plan.weights is not None:
            policy.load_state_dict({n: torch.from_numpy(w) for n, w in plan.weights.items()})
        self._noise, self._forgets, self._decision = torch.from_numpy(plan.noise), plan.forgets, 0
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
        self._states[now], self._before[now] = self._state.numpy(), self._previous.numpy()
        self._anew[now] = self._forgot
        seen = PolicyInput(torch.from_numpy(pictures), self._state, self._previous)
        decided = self._policy.decide(seen, self._noise[now])
        self._state, self._previous = decided.state, within_full_speed(decided.actions)
        wheels = self._previous.numpy()
        self._actions[now], self._known[now] = decided.actions.numpy(), decided.known.numpy()
        self._wheels[now] = wheels
        return wheels

    @torch.inference_mode()
    def arrive(self, ended: NDArray[np.bool_]) -> None:
        """Whose episodes ended remembers nothing."""
        self._forgot = ended | self._forgets[self._decision]
        self._decision += 1
        if self._forgot.any():
            keep = torch.from_numpy(~self._forgot).float().unsqueeze(1)
            self._state, self._previous = self._state * keep, self._previous * keep

    def decisions(self) -> Decisions:
        """Of the whole segment."""
        return Decisions(
            states=self._states,
            previous_actions=self._before,
            forgot=self._anew,
            actions=self._actions,
            wheels=self._wheels,
            known=self._known,
            after=HiddenState(self._state.numpy(), self._previous.numpy(), self._forgot),
        )
