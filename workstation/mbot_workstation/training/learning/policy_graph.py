"""The trained policy as an ONNX graph, written from its weights.

    observation -> float -> conv -> LeakyReLU -> conv -> LeakyReLU -> dense -> LeakyReLU -+-> wheels
                                                      previous_action, state_in -> GRU ---+

Some standard operators instead of an exporter: the graph is readable, small and old enough for any
onnxruntime, and it holds what SB3's own export leaves out, the clipping of the actions.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

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
    PREVIOUS_ACTION_NAME,
    STATE_IN_NAME,
    STATE_OUT_NAME,
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


_GRU_PARTS = ("weight_ih", "weight_hh", "bias_ih", "bias_hh")


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
    units = constants["memory.recurrent"].shape[2] if _has_memory(weights) else 0
    metadata = replace(metadata, contract_version=2 if units else 1)
    nodes = [
        helper.make_node("Cast", [INPUT_NAME], ["pixels"], name="pixels", to=TensorProto.FLOAT),
        helper.make_node("Transpose", ["pixels"], ["planes"], name="planes", perm=[0, 3, 1, 2]),
        *_layer("Conv", "planes", "first", strides=[4, 4]),
        *_layer("Conv", "first_active", "second", strides=[2, 2]),
        helper.make_node("Flatten", ["second_active"], ["flat"], name="flat", axis=1),
        *_layer("Gemm", "flat", "dense", transB=1),
        *(_memory(units) if units else ()),
        helper.make_node(
            "Gemm",
            ["known" if units else "dense_active", "wheels.weight", "wheels.bias"],
            ["wheels"],
            name="wheels",
            transB=1,
        ),
        helper.make_node("Clip", ["wheels", "backward", "forward"], [OUTPUT_NAME], name="clip"),
    ]
    picture = [BATCH, *OBSERVATION_SHAPE[1:]]
    inputs = [helper.make_tensor_value_info(INPUT_NAME, TensorProto.UINT8, picture)]
    outputs = [_floats(OUTPUT_NAME, BATCH, ACTION_SHAPE[1])]
    if units:
        inputs.append(_floats(PREVIOUS_ACTION_NAME, BATCH, ACTION_SHAPE[1]))
        inputs.append(_floats(STATE_IN_NAME, 1, BATCH, units))
        outputs.append(_floats(STATE_OUT_NAME, 1, BATCH, units))
    model = helper.make_model(
        helper.make_graph(
            nodes,
            "learned_policy",
            inputs,
            outputs,
            [numpy_helper.from_array(value, name) for name, value in constants.items()],
        ),
        opset_imports=[helper.make_opsetid("", OPSET)],
        ir_version=IR_VERSION,
        producer_name="mbot-agent",
    )
    helper.set_model_props(model, {**metadata.to_properties(), **(properties or {})})
    onnx.checker.check_model(model, full_check=True)
    return model


def _floats(name: str, *shape: int | str) -> onnx.ValueInfoProto:
    return helper.make_tensor_value_info(name, TensorProto.FLOAT, list(shape))


def _memory(units: int) -> list[onnx.NodeProto]:
    """A GRU of one step: features and the previous action in, features and state out as `known`."""
    inputs = ["moment", "memory.input", "memory.recurrent", "memory.bias", "", STATE_IN_NAME]
    return [
        helper.make_node("Concat", ["dense_active", PREVIOUS_ACTION_NAME], ["met"], "met", axis=1),
        helper.make_node("Unsqueeze", ["met", "first_axis"], ["moment"], "moment"),
        helper.make_node(
            "GRU",
            inputs,
            ["", STATE_OUT_NAME],
            "memory",
            hidden_size=units,
            linear_before_reset=1,  # as torch
        ),
        helper.make_node("Squeeze", [STATE_OUT_NAME, "first_axis"], ["recalled"], "recalled"),
        helper.make_node("Concat", ["dense_active", "recalled"], ["known"], "known", axis=1),
    ]


def _layer(
    kind: str, source: str, name: str, **attributes: int | list[int]
) -> list[onnx.NodeProto]:
    """A layer with its LeakyReLU, whose output is `<name>_active`."""
    node = helper.make_node(kind, [source, f"{name}.weight", f"{name}.bias"], [name], name=name)
    node.attribute.extend(helper.make_attribute(key, value) for key, value in attributes.items())
    active = f"{name}_active"
    return [node, helper.make_node("LeakyRelu", [name], [active], name=active, alpha=LEAKY_SLOPE)]


def _constants(weights: Mapping[str, torch.Tensor]) -> dict[str, NDArray[Any]]:
    arrays: dict[str, NDArray[Any]] = {
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
    if _has_memory(weights):
        gates = {part: _array(weights[f"memory.{part}"]) for part in _GRU_PARTS}
        ordered = {part: _update_first(value)[None] for part, value in gates.items()}
        arrays["memory.input"] = ordered["weight_ih"]
        arrays["memory.recurrent"] = ordered["weight_hh"]
        arrays["memory.bias"] = np.concatenate([ordered["bias_ih"], ordered["bias_hh"]], axis=1)
        arrays["first_axis"] = np.array([0], np.int64)
    return arrays


def _has_memory(weights: Mapping[str, torch.Tensor]) -> bool:
    return "memory.weight_hh" in weights


def _update_first(gates: NDArray[np.float32]) -> NDArray[np.float32]:
    """Torch's gates (reset, update, new) in ONNX's order (update, reset, new), or back again."""
    reset, update, new = np.split(gates, 3)
    return np.concatenate([update, reset, new])


def graph_weights(model: onnx.ModelProto) -> dict[str, torch.Tensor]:
    """The way back: a graph's weights by SB3's names, to single precision.

    Raises:
        KeyError: `policy_graph` did not write it.

    """
    arrays = {one.name: numpy_helper.to_array(one) for one in model.graph.initializer}
    first = arrays["first.weight"] / np.float32(PIXEL_SCALE)
    shift = np.float32(PIXEL_SHIFT) * first.sum((1, 2, 3))
    arrays |= {"first.weight": first, "first.bias": arrays["first.bias"] - shift}
    found = {
        f"{origin}.{part}": arrays[f"{name}.{part}"]
        for name, origin in _LAYERS.items()
        for part in ("weight", "bias")
    }
    if "memory.bias" in arrays:
        bias_ih, bias_hh = np.split(arrays["memory.bias"][0], 2)
        gates = (arrays["memory.input"][0], arrays["memory.recurrent"][0], bias_ih, bias_hh)
        for part, value in zip(_GRU_PARTS, gates, strict=True):
            found[f"memory.{part}"] = _update_first(value)
    return {name: torch.from_numpy(value.copy()) for name, value in found.items()}


def _array(tensor: torch.Tensor) -> NDArray[np.float32]:
    return np.ascontiguousarray(tensor.detach().cpu().numpy(), np.float32)
