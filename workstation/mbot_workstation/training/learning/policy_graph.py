"""The trained policy as an ONNX graph, written from its weights.

    observation -> float -> conv -> LeakyReLU -> conv -> LeakyReLU -> dense -> LeakyReLU -> wheels

Ten standard operators instead of an exporter: the graph is readable, small and old enough for any
onnxruntime, and it holds what SB3's own export leaves out, the clipping of the actions.
"""

from collections.abc import Mapping

import numpy as np
import onnx
import torch
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

from mbot_protocol.policy_contract import (
    ACTION_SHAPE,
    INPUT_NAME,
    OBSERVATION_SHAPE,
    OUTPUT_NAME,
    PolicyMetadata,
)
from mbot_workstation.training.learning.network import LEAKY_SLOPE, PIXEL_SCALE, PIXEL_SHIFT

OPSET = 13
IR_VERSION = 8
"""As the servo policy: every onnxruntime since 1.10 runs it."""

BATCH = "batch"
"""The contract lets a symbolic dimension stand for the batch; evaluation runs many at once."""

_FEATURES = "features_extractor."
_LAYERS = {
    "first": f"{_FEATURES}first",
    "second": f"{_FEATURES}second",
    "dense": f"{_FEATURES}dense",
    "wheels": "action_net",
}
"""The graph's layers and their names in SB3's policy."""


def policy_graph(
    weights: Mapping[str, torch.Tensor],
    metadata: PolicyMetadata,
    properties: Mapping[str, str] | None = None,
) -> onnx.ModelProto:
    """Build the model.

    Args:
        weights: of the learner's policy by SB3's names, from `read_weights` or `state_dict()`.
        metadata: what it says of itself.
        properties: further metadata.

    Returns:
        A model that follows the policy contract: standard operators, no external data.

    """
    constants = _constants(weights)
    nodes = [
        helper.make_node("Cast", [INPUT_NAME], ["pixels"], name="pixels", to=TensorProto.FLOAT),
        helper.make_node("Transpose", ["pixels"], ["planes"], name="planes", perm=[0, 3, 1, 2]),
        *_layer("Conv", "planes", "first", strides=[4, 4]),
        *_layer("Conv", "first_active", "second", strides=[2, 2]),
        helper.make_node("Flatten", ["second_active"], ["flat"], name="flat", axis=1),
        *_layer("Gemm", "flat", "dense", transB=1),
        helper.make_node(
            "Gemm",
            ["dense_active", "wheels.weight", "wheels.bias"],
            ["wheels"],
            name="wheels",
            transB=1,
        ),
        helper.make_node("Clip", ["wheels", "backward", "forward"], [OUTPUT_NAME], name="clip"),
    ]
    observation = [BATCH, *OBSERVATION_SHAPE[1:]]
    model = helper.make_model(
        helper.make_graph(
            nodes,
            "learned_policy",
            [helper.make_tensor_value_info(INPUT_NAME, TensorProto.UINT8, observation)],
            [
                helper.make_tensor_value_info(
                    OUTPUT_NAME, TensorProto.FLOAT, [BATCH, ACTION_SHAPE[1]]
                )
            ],
            [numpy_helper.from_array(value, name) for name, value in constants.items()],
        ),
        opset_imports=[helper.make_opsetid("", OPSET)],
        ir_version=IR_VERSION,
        producer_name="mbot-agent",
    )
    helper.set_model_props(model, {**metadata.to_properties(), **(properties or {})})
    onnx.checker.check_model(model, full_check=True)
    return model


def _layer(
    kind: str, source: str, name: str, **attributes: int | list[int]
) -> list[onnx.NodeProto]:
    """A layer with its LeakyReLU, whose output is `<name>_active`."""
    node = helper.make_node(kind, [source, f"{name}.weight", f"{name}.bias"], [name], name=name)
    node.attribute.extend(helper.make_attribute(key, value) for key, value in attributes.items())
    active = f"{name}_active"
    return [node, helper.make_node("LeakyRelu", [name], [active], name=active, alpha=LEAKY_SLOPE)]


def _constants(weights: Mapping[str, torch.Tensor]) -> dict[str, NDArray[np.float32]]:
    arrays = {
        f"{name}.{part}": _array(weights[f"{origin}.{part}"])
        for name, origin in _LAYERS.items()
        for part in ("weight", "bias")
    }
    # Raw pixels go into the first convolution; scaling and shifting them is in its weights.
    first = arrays["first.weight"]
    arrays["first.bias"] = arrays["first.bias"] + np.float32(PIXEL_SHIFT) * first.sum((1, 2, 3))
    arrays["first.weight"] = first * np.float32(PIXEL_SCALE)
    arrays["backward"] = np.array(-1.0, np.float32)
    arrays["forward"] = np.array(1.0, np.float32)
    return arrays


def graph_weights(model: onnx.ModelProto) -> dict[str, torch.Tensor]:
    """The way back: a graph's weights by SB3's names, to single precision.

    Raises:
        KeyError: `policy_graph` did not write it.

    """
    arrays = {one.name: numpy_helper.to_array(one) for one in model.graph.initializer}
    first = arrays["first.weight"] / np.float32(PIXEL_SCALE)
    shift = np.float32(PIXEL_SHIFT) * first.sum((1, 2, 3))
    arrays |= {"first.weight": first, "first.bias": arrays["first.bias"] - shift}
    return {
        f"{origin}.{part}": torch.from_numpy(arrays[f"{name}.{part}"].copy())
        for name, origin in _LAYERS.items()
        for part in ("weight", "bias")
    }


def _array(tensor: torch.Tensor) -> NDArray[np.float32]:
    return np.ascontiguousarray(tensor.detach().cpu().numpy(), np.float32)
