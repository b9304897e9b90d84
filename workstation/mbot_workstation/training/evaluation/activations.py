"""What the first layer of a policy makes of a picture, from the ONNX file alone."""

from dataclasses import dataclass

import numpy as np
import onnx
import onnxruntime
from numpy.typing import NDArray
from onnx import TensorProto, helper

from mbot_protocol.errors import ContractError
from mbot_protocol.picture import Picture
from mbot_protocol.policy_contract import INPUT_NAME, OUTPUT_NAME

ACTIVATIONS = ("LeakyRelu", "Relu")


@dataclass(frozen=True, slots=True)
class Activations:
    """One picture on its way through the first layer.

    Attributes:
        frame: shape (64, 64, 3).
        convolution: outputs of the first convolution, shape (filters, h, w).
        activation: the same after the LeakyReLU.
        action: left and right wheel.

    """

    frame: Picture
    convolution: NDArray[np.float32]
    activation: NDArray[np.float32]
    action: tuple[float, float]


class Microscope:
    """A policy whose inner values can be seen."""

    def __init__(self, model: bytes) -> None:
        """Open a model up.

        Raises:
            ContractError: it has no convolution that a LeakyReLU or ReLU follows.

        """
        opened = onnx.load_from_string(model)
        self._inner = _first_layer(opened.graph)
        opened.graph.output.extend(
            helper.make_tensor_value_info(name, TensorProto.FLOAT, None) for name in self._inner
        )
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        self._session = onnxruntime.InferenceSession(
            opened.SerializeToString(), options, providers=["CPUExecutionProvider"]
        )
        self._nothing_before = {
            tensor.name: np.zeros(
                [n if isinstance(n, int) else 1 for n in tensor.shape], np.float32
            )
            for tensor in self._session.get_inputs()
            if tensor.name != INPUT_NAME
        }

    def look(self, frame: Picture) -> Activations:
        """Run one observation, shape (64, 64, 3), through the policy, as if nothing had been before
        it.
        """
        names = [OUTPUT_NAME, *self._inner]
        feeds = {INPUT_NAME: frame[None], **self._nothing_before}
        action, convolution, activation = (
            np.asarray(value)[0] for value in self._session.run(names, feeds)
        )
        return Activations(frame, convolution, activation, (float(action[0]), float(action[1])))


def _first_layer(graph: onnx.GraphProto) -> tuple[str, str]:
    """Names of the first convolution's output, and of what follows it."""
    for node in graph.node:
        if node.op_type != "Conv":
            continue
        output = node.output[0]
        for follower in graph.node:
            if follower.op_type in ACTIVATIONS and output in follower.input:
                return output, follower.output[0]
        break
    raise ContractError(
        "the model's first convolution is not followed by a LeakyReLU or ReLU, so there is nothing "
        "to explain; expected a model from `workstation export`"
    )
