"""Any model that follows the policy contract, run by onnxruntime on this machine."""

import os
from pathlib import Path
from typing import cast

os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")  # read when onnxruntime is imported

import numpy as np
import onnxruntime
from numpy.typing import NDArray

from mbot_protocol.errors import ContractError
from mbot_protocol.policy_contract import INPUT_NAME, OUTPUT_NAME, PolicyMetadata

Pictures = NDArray[np.uint8]
"""Shape (robots, 64, 64, 3), RGB."""
Actions = NDArray[np.float32]
"""Shape (robots, 2): left and right wheel in [-1, 1]."""


class OnnxPolicy:
    """Any model that follows the policy contract.

    Attributes:
        metadata: what it says of itself.

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
            raise ContractError(f"onnxruntime does not take the model: {error}") from None
        properties = self._session.get_modelmeta().custom_metadata_map
        self.metadata = PolicyMetadata.from_properties(properties)
        self._takes_batches = not isinstance(self._session.get_inputs()[0].shape[0], int)

    @classmethod
    def load(cls, path: Path) -> "OnnxPolicy":
        """Load a file after checking it against the contract; raises as `check_model`."""
        from mbot_workstation.models.check import check_model

        return cls(check_model(path).data)

    def act(self, observations: Pictures) -> Actions:
        """All at once where the model allows it, else one after the other."""
        if self._takes_batches:
            return self._run(observations)
        return np.concatenate([self._run(picture[None]) for picture in observations])

    def _run(self, observations: Pictures) -> Actions:
        (actions,) = self._session.run([OUTPUT_NAME], {INPUT_NAME: observations})
        return cast(Actions, actions)
