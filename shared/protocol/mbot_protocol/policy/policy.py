"""The policy: an ONNX model, checked against the contract, and its answers.

Whoever decides by a model runs this one: the robot, its dry run, a replay, an evaluation. So what
one of them answers, the others do, to the last bit on the same kind of processor.
"""

import hashlib
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbot_protocol.drive.picture import Picture
from mbot_protocol.errors import ContractError, MbotError
from mbot_protocol.policy.engine import engine_words, load_engine
from mbot_protocol.policy.golden_frames import GoldenFrame, read_golden_frames
from mbot_protocol.policy.model_structure import check_structure
from mbot_protocol.policy.policy_contract import (
    INPUT_NAME,
    LARGEST_MODEL_BYTES,
    OUTPUT_NAME,
    PREVIOUS_ACTION_NAME,
    STATE_IN_NAME,
    STATE_OUT_NAME,
    Memory,
    PolicyMetadata,
    check_signature,
)

Pictures = NDArray[np.uint8]
"""Shape (robots, 64, 64, 3), RGB."""
Actions = NDArray[np.float32]
"""Shape (robots, 2): left and right wheel in [-1, 1]."""


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
        takes_batches: `infer` may be asked for several robots at once.

    """

    def __init__(self, data: bytes) -> None:
        """Load a model.

        Args:
            data: the whole ONNX file; external data is refused, as there is no folder to find it.

        Raises:
            ContractError: too large, not ONNX, made of what is not allowed (see
                `model_structure.py`), or not following the contract.
            NewerSchemaError: it follows a newer contract.

        """
        if len(data) > LARGEST_MODEL_BYTES:
            raise ContractError(
                f"the model has {len(data)} bytes, expected at most {LARGEST_MODEL_BYTES}"
            )
        declared = check_structure(data)
        self.sha256 = hashlib.sha256(data).hexdigest()
        self.size_bytes = len(data)
        self._properties = declared.properties
        self.metadata = PolicyMetadata.from_properties(declared.properties)
        version = self.metadata.contract_version
        memory = check_signature(declared.inputs, declared.outputs, version)
        self.takes_batches = all(
            not isinstance(one.shape[0], int) for one in declared.inputs if one.name == INPUT_NAME
        )
        self._engine = load_engine(data)
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
        return read_golden_frames(self._properties)

    def decide(self, observation: Picture, memory: Memory) -> Answer:
        """Decide.

        Args:
            observation: shape (64, 64, 3), uint8, RGB.
            memory: what the last answer left, or `blank`.

        Raises:
            PolicyError: inference failed, or the answer is not two finite numbers.

        """
        previous_action = np.array([memory.previous_action], np.float32)
        try:
            action, state = self.infer(observation[np.newaxis], previous_action, memory.state)
            left, right = (float(value) for value in action.reshape(2))
        except Exception as error:
            raise PolicyError(f"the model failed on a picture: {engine_words(error)}") from None
        if not (math.isfinite(left) and math.isfinite(right)):
            raise PolicyError(f"the model answered ({left}, {right}), expected two finite numbers")
        if not np.isfinite(state).all():
            raise PolicyError("the model remembers what is not finite")
        return Answer(left, right, state)

    def infer(
        self, observations: Pictures, previous_actions: Actions, state: NDArray[np.float32]
    ) -> tuple[Actions, NDArray[np.float32]]:
        """What the model says for n robots, as it is, and their next state; n is 1 unless it
        `takes_batches`. Raises whatever the engine does.

        Args:
            observations: of each.
            previous_actions: what their wheels were really told.
            state: what it remembers of them, shape (layers, n, units).

        """
        if not self.has_memory:
            (actions,) = self._engine.run([OUTPUT_NAME], {INPUT_NAME: observations})
            return np.asarray(actions, np.float32), state
        feeds: dict[str, NDArray[Any]] = {
            INPUT_NAME: observations,
            PREVIOUS_ACTION_NAME: previous_actions,
            STATE_IN_NAME: state,
        }
        actions, after = self._engine.run([OUTPUT_NAME, STATE_OUT_NAME], feeds)
        return np.asarray(actions, np.float32), np.asarray(after, np.float32)
