"""Any model that follows the policy contract, run by onnxruntime on this machine."""

import os
from pathlib import Path
from typing import Any, cast

os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")  # read when onnxruntime is imported

import numpy as np
import onnxruntime
from numpy.typing import NDArray

from mbot_protocol.drive.actions import STEP_LIMIT
from mbot_protocol.errors import ContractError
from mbot_protocol.policy.engine_words import engine_words
from mbot_protocol.policy.policy_contract import (
    INPUT_NAME,
    OUTPUT_NAME,
    PREVIOUS_ACTION_NAME,
    STATE_IN_NAME,
    STATE_OUT_NAME,
    PolicyMetadata,
)

Pictures = NDArray[np.uint8]
"""Shape (robots, 64, 64, 3), RGB."""
Actions = NDArray[np.float32]
"""Shape (robots, 2): left and right wheel in [-1, 1]."""


class OnnxPolicy:
    """Any model that follows the policy contract.

    Attributes:
        metadata: what it says of itself.
        state: what it remembers of each robot, shape (layers, robots, units); none without memory.
        previous_actions: what each robot's wheels were told, shape (robots, 2).

    """

    def __init__(self, model: bytes) -> None:
        """Load a model.

        Raises:
            ContractError: onnxruntime can't run it, or its metadata is incomplete.

        """
        options = onnxruntime.SessionOptions()
        # The simulation keeps the cores busy; a picture takes a fraction of a millisecond.
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 3
        try:
            self._session = onnxruntime.InferenceSession(
                model, options, providers=["CPUExecutionProvider"]
            )
        except Exception as error:  # onnxruntime's errors share no base class
            raise ContractError(
                f"onnxruntime does not take the model: {engine_words(error)}"
            ) from None
        properties = self._session.get_modelmeta().custom_metadata_map
        self.metadata = PolicyMetadata.from_properties(properties)
        shapes = {tensor.name: tensor.shape for tensor in self._session.get_inputs()}
        self._takes_batches = not isinstance(shapes[INPUT_NAME][0], int)
        layers, _, units = shapes.get(STATE_IN_NAME, (0, 1, 0))
        self.state = np.zeros((layers, 1, units), np.float32)
        self.previous_actions = np.zeros((1, 2), np.float32)

    @classmethod
    def load(cls, path: Path) -> "OnnxPolicy":
        """Load a file after checking it against the contract; raises as `check_model`."""
        from mbot_workstation.fleet.models.check import check_model

        return cls(check_model(path).data)

    def act(self, observations: Pictures) -> Actions:
        """Decide for some robots; of each it remembers what is needed for its next decision.

        All at once where the model allows it, else one after the other. For another number of
        robots than before it begins anew.
        """
        robots = len(observations)
        if self.state.shape[1] != robots:
            layers, _, units = self.state.shape
            self.state = np.zeros((layers, robots, units), np.float32)
            self.previous_actions = np.zeros((robots, 2), np.float32)
        one_by_one = [slice(row, row + 1) for row in range(robots)]
        rows = [slice(None)] if self._takes_batches else one_by_one
        actions = np.concatenate([self._run(observations, row) for row in rows])
        self.previous_actions = np.round(np.clip(actions, -1, 1) * STEP_LIMIT) / np.float32(
            STEP_LIMIT
        )
        return actions

    def forget(self, robots: NDArray[np.bool_] | None = None) -> None:
        """Begin anew for these robots, shape (robots,), or for all."""
        which = slice(None) if robots is None else robots
        self.state[:, which] = 0
        self.previous_actions[which] = 0

    def _run(self, observations: Pictures, row: slice) -> Actions:
        if not self.state.size:
            (actions,) = self._session.run([OUTPUT_NAME], {INPUT_NAME: observations[row]})
            return cast(Actions, actions)
        feeds = {
            INPUT_NAME: observations[row],
            PREVIOUS_ACTION_NAME: self.previous_actions[row],
            STATE_IN_NAME: self.state[:, row],
        }
        actions, state = self._session.run([OUTPUT_NAME, STATE_OUT_NAME], feeds)
        self.state[:, row] = cast(Any, state)
        return cast(Actions, actions)
