"""The policy: an ONNX model, checked against the contract, and its answers."""

import hashlib
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbot_agent.models.model_engine import load_engine
from mbot_agent.tick import Memory
from mbot_protocol.drive.picture import Picture
from mbot_protocol.errors import ContractError, MbotError
from mbot_protocol.policy.engine_words import engine_words
from mbot_protocol.policy.golden_frames import GoldenFrame, read_golden_frames
from mbot_protocol.policy.model_structure import check_structure
from mbot_protocol.policy.policy_contract import (
    INPUT_NAME,
    LARGEST_MODEL_BYTES,
    OUTPUT_NAME,
    PREVIOUS_ACTION_NAME,
    STATE_IN_NAME,
    STATE_OUT_NAME,
    PolicyMetadata,
    check_signature,
)
from mbot_protocol.policy.static_shapes import check_static_shapes


class PolicyError(MbotError):
    """The model failed on a picture; its answer must not reach a motor."""


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """A decision: left and right wheel, finite, not yet clipped, and what the model remembers."""

    left: float
    right: float
    state: NDArray[np.float32]


class Policy:
    """A loaded model. It keeps nothing between decisions: who runs it keeps its `Memory`.

    Attributes:
        sha256: digest of the file, hexadecimal.
        size_bytes: its length.
        metadata: what it says of itself.
        blank: the memory to begin with.

    """

    def __init__(self, data: bytes) -> None:
        """Load a model.

        Args:
            data: the whole ONNX file; external data is refused, as there is no folder to find it.

        Raises:
            ContractError: too large, not ONNX, made of what is not allowed (see
                `mbot_protocol.policy.model_structure` and `static_shapes`), or not following the
                contract.
            NewerSchemaError: it follows a newer contract.

        """
        if len(data) > LARGEST_MODEL_BYTES:
            raise ContractError(
                f"the model has {len(data)} bytes, expected at most {LARGEST_MODEL_BYTES}"
            )
        check_structure(data)
        check_static_shapes(data)
        self.sha256 = hashlib.sha256(data).hexdigest()
        self.size_bytes = len(data)
        self._engine = load_engine(data)
        self.metadata = PolicyMetadata.from_properties(self._engine.properties)
        memory = check_signature(
            self._engine.inputs, self._engine.outputs, self.metadata.contract_version
        )
        self.blank = Memory(np.zeros((memory.layers, 1, memory.units), np.float32))

    @classmethod
    def load(cls, path: Path) -> "Policy":
        """Load a model file.

        Raises:
            ContractError: as the constructor, or the file cannot be read.

        """
        try:
            data = path.read_bytes()
        except OSError as error:
            raise ContractError(f"cannot read the model {path}: {error.strerror}") from None
        return cls(data)

    @property
    def has_memory(self) -> bool:
        """Whether what it answers depends on what was before."""
        return self.blank.state.size > 0

    def golden_frames(self) -> list[GoldenFrame]:
        """The pictures the model brings along with the actions it should give.

        Raises:
            ContractError: they are damaged.

        """
        return read_golden_frames(self._engine.properties)

    def act(self, observation: Picture) -> tuple[float, float]:
        """Decide as if nothing had been before: left and right wheel; raises as `decide`."""
        answer = self.decide(observation, self.blank)
        return answer.left, answer.right

    def decide(self, observation: Picture, memory: Memory) -> Answer:
        """Decide.

        Args:
            observation: shape (64, 64, 3), uint8, RGB.
            memory: what the last answer left, or `blank`.

        Raises:
            PolicyError: inference failed, or the answer is not two finite numbers.

        """
        feeds: dict[str, Any] = {INPUT_NAME: observation[np.newaxis]}
        names = [OUTPUT_NAME]
        if self.has_memory:
            feeds[PREVIOUS_ACTION_NAME] = np.array([memory.previous_action], np.float32)
            feeds[STATE_IN_NAME] = memory.state
            names.append(STATE_OUT_NAME)
        try:
            action, *states = self._engine.run(names, feeds)
            left, right = (float(value) for value in np.asarray(action).reshape(2))
            state = np.asarray(states[0], np.float32) if states else memory.state
        except Exception as error:
            raise PolicyError(f"the model failed on a picture: {engine_words(error)}") from None
        if not (math.isfinite(left) and math.isfinite(right)):
            raise PolicyError(f"the model answered ({left}, {right}), expected two finite numbers")
        if not np.isfinite(state).all():
            raise PolicyError("the model remembers what is not finite")
        return Answer(left, right, state)
