"""Any model that follows the policy contract, for one robot or many at once."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mbot_protocol.drive.actions import STEP_LIMIT
from mbot_protocol.policy.policy import Actions, Pictures, Policy


class OnnxPolicy:
    """A policy that drives a number of robots.

    Attributes:
        metadata: what it says of itself.
        state: what it remembers of each robot, shape (layers, robots, units); none without memory.
        previous_actions: what each robot's wheels were told, shape (robots, 2).

    """

    def __init__(self, model: bytes) -> None:
        """Load a model; raises ContractError as `Policy`."""
        self._policy = Policy(model)
        self.metadata = self._policy.metadata
        self._begin(1)

    @classmethod
    def load(cls, path: Path) -> "OnnxPolicy":
        """Load a file after checking it against the contract; raises as `check_model`."""
        from mbot_workstation.fleet.models.check import check_model

        return cls(check_model(path).data)

    def act(self, observations: Pictures) -> Actions:
        """Decide for some robots; of each it remembers what is needed for its next decision.

        All at once where the model allows it, else one after the other. For another number of
        robots than before it starts over.
        """
        robots = len(observations)
        if len(self.previous_actions) != robots:
            self._begin(robots)
        one_by_one = [slice(row, row + 1) for row in range(robots)]
        rows = [slice(None)] if self._policy.takes_batches else one_by_one
        actions = np.concatenate([self._infer(observations, row) for row in rows])
        self.previous_actions = np.round(np.clip(actions, -1, 1) * STEP_LIMIT) / np.float32(
            STEP_LIMIT
        )
        return actions

    def forget(self, robots: NDArray[np.bool_] | None = None) -> None:
        """Start over for these robots, shape (robots,), or for all."""
        which = slice(None) if robots is None else robots
        self.state[:, which] = 0
        self.previous_actions[which] = 0

    def _begin(self, robots: int) -> None:
        layers, _, units = self._policy.blank.state.shape
        self.state = np.zeros((layers, robots, units), np.float32)
        self.previous_actions = np.zeros((robots, 2), np.float32)

    def _infer(self, observations: Pictures, row: slice) -> Actions:
        actions, self.state[:, row] = self._policy.infer(
            observations[row], self.previous_actions[row], self.state[:, row]
        )
        return actions
