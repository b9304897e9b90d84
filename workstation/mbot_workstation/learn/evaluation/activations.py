"""What a policy makes of a picture, from the ONNX file alone: where it looks, what its first layer
shows, what it remembers.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper

from mbot_protocol.drive.picture import Picture
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.policy.engine import load_engine
from mbot_protocol.policy.onnx_file import read_onnx
from mbot_protocol.policy.policy_contract import (
    INPUT_NAME,
    OBSERVATION_SIDE_PX,
    OUTPUT_NAME,
    PREVIOUS_ACTION_NAME,
    STATE_IN_NAME,
    STATE_OUT_NAME,
)

ACTIVATIONS = ("LeakyRelu", "Relu")

HIDDEN_PX, APART_PX = 8, 4
"""Side of what is hidden at a time, a cube's width at half a metre, and how far apart."""

Feeds = dict[str, NDArray[np.float32] | Picture]


@dataclass(frozen=True, slots=True)
class Activations:
    """One picture on its way through a policy.

    Attributes:
        frame: shape (64, 64, 3).
        action: left and right wheel.
        first_action: the same if nothing had been before this picture; None where nothing had.
        saliency: how much the wheels change when what is here is blurred away, the larger of both,
            shape (n, n) over the picture.
        convolution: outputs of the first convolution, shape (filters, h, w); None if the policy has
            none that a LeakyReLU or ReLU follows.
        activation: the same after that.

    """

    frame: Picture
    action: tuple[float, float]
    first_action: tuple[float, float] | None
    saliency: NDArray[np.float32]
    convolution: NDArray[np.float32] | None
    activation: NDArray[np.float32] | None


@dataclass(frozen=True, slots=True)
class Glance:
    """One picture of a drive.

    Attributes:
        frame: shape (64, 64, 3).
        told: what the wheels were really told after the picture before, left and right in [-1, 1];
            None: the policy starts over here.

    """

    frame: Picture
    told: tuple[float, float] | None = None


class ActivationReader:
    """A policy whose inner values can be seen. Any that keeps the contract."""

    def __init__(self, model: bytes) -> None:
        opened = onnx.load_from_string(model)
        self._inner = _first_layer(opened.graph)
        opened.graph.output.extend(
            helper.make_tensor_value_info(name, TensorProto.FLOAT, None) for name in self._inner
        )
        self._engine = load_engine(opened.SerializeToString())
        self._nothing_before: Feeds = {
            tensor.name: np.zeros(
                [n if isinstance(n, int) else 1 for n in tensor.shape], np.float32
            )
            for tensor in read_onnx(model).inputs
            if tensor.name != INPUT_NAME
        }

    @property
    def remembers(self) -> bool:
        """Whether what was before makes a difference to it."""
        return STATE_IN_NAME in self._nothing_before

    def look(self, frame: Picture) -> Activations:
        """Run one observation, shape (64, 64, 3), through the policy, as if nothing had been before
        it.
        """
        return self._look(frame, self._nothing_before)

    def look_on(self, frame: Picture, told: tuple[float, float], memory: bytes) -> Activations:
        """Run one observation of a drive, with what the robot had in mind.

        Args:
            frame: shape (64, 64, 3).
            told: what the wheels were told before, left and right in [-1, 1].
            memory: as recorded, float32, little endian; empty where the policy started over.

        Raises:
            ConfigurationError: the memory is not this policy's.

        """
        if not self.remembers or not memory:
            return self.look(frame)
        blank = self._nothing_before[STATE_IN_NAME]
        state = np.frombuffer(memory, "<f4")
        if state.size != blank.size:
            raise ConfigurationError(
                f"{state.size} numbers of memory are recorded, the model has {blank.size}"
            )
        before: Feeds = {
            PREVIOUS_ACTION_NAME: np.array([told], np.float32),
            STATE_IN_NAME: state.reshape(blank.shape).astype(np.float32),
        }
        return replace(self._look(frame, before), first_action=self._first_action(frame))

    def look_back(self, drive: Sequence[Glance], chosen: Sequence[int]) -> list[Activations]:
        """Look at some pictures of a drive, with what the policy would have in mind by then.

        Args:
            drive: its pictures, one a decision.
            chosen: indices of those to look at, rising.

        """
        if not self.remembers:
            return [self.look(drive[index].frame) for index in chosen]
        found: list[Activations] = []
        state = self._nothing_before[STATE_IN_NAME]
        for index, glance in enumerate(drive[: chosen[-1] + 1]):
            before = self._nothing_before
            if glance.told is not None:
                told = np.array([glance.told], np.float32)
                before = {PREVIOUS_ACTION_NAME: told, STATE_IN_NAME: state}
            if index in chosen:
                first = self._first_action(glance.frame)
                found.append(replace(self._look(glance.frame, before), first_action=first))
            (after,) = self._engine.run(
                [STATE_OUT_NAME], {INPUT_NAME: glance.frame[None], **before}
            )
            state = np.asarray(after, np.float32)
        return found

    def _first_action(self, frame: Picture) -> tuple[float, float]:
        left, right = self._action(frame, self._nothing_before)
        return float(left), float(right)

    def _look(self, frame: Picture, before: Feeds) -> Activations:
        feeds = {INPUT_NAME: frame[None], **before}
        action, *inner = (
            np.asarray(value)[0] for value in self._engine.run([OUTPUT_NAME, *self._inner], feeds)
        )
        convolution, activation = inner or (None, None)
        told = float(action[0]), float(action[1])
        saliency = self._saliency(frame, before, action)
        return Activations(frame, told, None, saliency, convolution, activation)

    def _saliency(
        self, frame: Picture, before: Feeds, action: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        """Occlusion (Zeiler and Fergus 2014), with a blur: a gray patch would be a thing itself."""
        blurred = cv2.GaussianBlur(frame, (0, 0), HIDDEN_PX)
        corners = range(0, OBSERVATION_SIDE_PX - HIDDEN_PX + 1, APART_PX)
        found = np.zeros((len(corners), len(corners)), np.float32)
        for row, top in enumerate(corners):
            for column, left in enumerate(corners):
                hidden = frame.copy()
                patch = np.s_[top : top + HIDDEN_PX, left : left + HIDDEN_PX]
                hidden[patch] = blurred[patch]
                found[row, column] = np.abs(self._action(hidden, before) - action).max()
        return found

    def _action(self, frame: Picture, before: Feeds) -> NDArray[np.float32]:
        (action,) = self._engine.run([OUTPUT_NAME], {INPUT_NAME: frame[None], **before})
        return np.asarray(action, np.float32)[0]


def _first_layer(graph: onnx.GraphProto) -> tuple[str, ...]:
    """Names of the first convolution's output, and of what follows it; () if it has none."""
    for node in graph.node:
        if node.op_type != "Conv":
            continue
        output = node.output[0]
        for follower in graph.node:
            if follower.op_type in ACTIVATIONS and output in follower.input:
                return output, follower.output[0]
        break
    return ()
