"""The trained policy as an ONNX graph, written from its weights.

    observation -> float -> conv -> conv (-> + conv) -> dense (-> + dense) -+
        wheels -> bounds <-+---------------------------------------------+
        previous_action, state_in -> GRU ---+

Every convolution and dense layer is followed by a LeakyReLU; those in brackets only a deeper
network has, and they are added to their own input. The residual network's convolutions are as
residual_network.py has them.

Some standard operators instead of an exporter: the graph is readable, small and old enough for any
onnxruntime, and it holds what SB3's own export leaves out, the bounds of the actions.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import onnx
import torch
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

from mbot_protocol.policy.policy_contract import (
    ACTION_SHAPE,
    INPUT_NAME,
    OBSERVATION_SHAPE,
    OUTPUT_NAME,
    PREVIOUS_ACTION_NAME,
    STATE_IN_NAME,
    STATE_OUT_NAME,
    PolicyMetadata,
)
from mbot_workstation.learn.learning.full_speed import (
    KEEPS_TURNS,
    full_speed_constants,
    full_speed_nodes,
)
from mbot_workstation.learn.learning.memory_graph import (
    FEATURES,
    PARTS,
    MemoryGraph,
    gru,
    memory_parts,
    spelt_out_gru,
)
from mbot_workstation.learn.learning.network import (
    LEAKY_SLOPE,
    PIXEL_SCALE,
    PIXEL_SHIFT,
    first_stride,
)

OPSET = 13
ARMV6_OPSET = 10
"""Clip and Squeeze took their limits and axes as attributes, which is what OpenCV 4.6 reads."""
IR_VERSION = 8
"""As the servo policy: every onnxruntime since 1.10 runs it."""

BATCH = "batch"
"""The contract lets a symbolic dimension stand for the batch; evaluation runs many at once."""

_FEATURES = "features_extractor."
_ORIGINS = {
    "first": f"{_FEATURES}first",
    "second": f"{_FEATURES}second",
    "third": f"{_FEATURES}third",
    "fourth": f"{_FEATURES}fourth",
    "near.inner": f"{_FEATURES}near.inner",
    "near.outer": f"{_FEATURES}near.outer",
    "far.inner": f"{_FEATURES}far.inner",
    "far.outer": f"{_FEATURES}far.outer",
    "dense": f"{_FEATURES}dense",
    "mixing": f"{_FEATURES}mixing",
    "wheels": "action_net",
}
"""The graph's layers and their names in SB3's policy; no network has all of them."""


def policy_graph(
    weights: Mapping[str, torch.Tensor],
    metadata: PolicyMetadata,
    properties: Mapping[str, str] | None = None,
    *,
    for_armv6: bool = False,
) -> onnx.ModelProto:
    """Build the model.

    Args:
        weights: of the learner's policy by SB3's names, from `read_weights` or `state_dict()`.
        metadata: what it says of itself.
        properties: further metadata.
        for_armv6: in what OpenCV 4.6 takes as well: an older operator set, one picture a batch.

    Returns:
        A model that follows the policy contract: standard operators, no external data.

    """
    constants = _constants(weights)
    parts = {part: _array(weights[f"memory.{part}"]) for part in PARTS if _has_memory(weights)}
    memory = (spelt_out_gru if for_armv6 else gru)(parts) if parts else MemoryGraph([], {})
    metadata = replace(metadata, contract_version=2 if parts else 1)
    deeper = f"{_ORIGINS['mixing']}.weight" in weights
    keeps_turns = KEEPS_TURNS in weights
    bounded = _bounded(for_armv6, keeps_turns=keeps_turns)
    nodes = [
        helper.make_node("Cast", [INPUT_NAME], ["pixels"], name="pixels", to=TensorProto.FLOAT),
        helper.make_node("Transpose", ["pixels"], ["planes"], name="planes", perm=[0, 3, 1, 2]),
        *_convolutions(weights, for_armv6),
        *_layer("Gemm", "flat", "dense", transB=1),
        *_more(deeper, "Gemm", "dense_active", "mixing", FEATURES, transB=1),
        *memory.nodes,
        _gemm("known" if parts else FEATURES, "wheels"),
        *bounded,
    ]
    if not for_armv6:
        constants |= {"backward": np.array(-1.0, np.float32), "forward": np.array(1.0, np.float32)}
    constants |= memory.constants | (full_speed_constants() if keeps_turns else {})
    if for_armv6:
        _put_outputs_first(nodes, constants)
    model = helper.make_model(
        helper.make_graph(
            nodes,
            "learned_policy",
            *_signature(parts["weight_hh"].shape[1] if parts else 0, 1 if for_armv6 else BATCH),
            [numpy_helper.from_array(value, name) for name, value in constants.items()],
        ),
        opset_imports=[helper.make_opsetid("", ARMV6_OPSET if for_armv6 else OPSET)],
        ir_version=IR_VERSION,
        producer_name="mbot-agent",
    )
    helper.set_model_props(model, {**metadata.to_properties(), **(properties or {})})
    onnx.checker.check_model(model, full_check=True)
    return model


def _signature(
    units: int, batch: int | str
) -> tuple[list[onnx.ValueInfoProto], list[onnx.ValueInfoProto]]:
    """Inputs and outputs of a network with so many units of memory."""
    picture = [batch, *OBSERVATION_SHAPE[1:]]
    inputs = [helper.make_tensor_value_info(INPUT_NAME, TensorProto.UINT8, picture)]
    outputs = [_floats(OUTPUT_NAME, batch, ACTION_SHAPE[1])]
    if units:
        inputs.append(_floats(PREVIOUS_ACTION_NAME, batch, ACTION_SHAPE[1]))
        inputs.append(_floats(STATE_IN_NAME, 1, batch, units))
        outputs.append(_floats(STATE_OUT_NAME, 1, batch, units))
    return inputs, outputs


def _kernel(for_armv6: bool, side: int) -> dict[str, list[int]]:
    """Its size, which its weights tell onnxruntime."""
    return {"kernel_shape": [side, side]} if for_armv6 else {}


def _bounded(for_armv6: bool, *, keeps_turns: bool) -> list[onnx.NodeProto]:
    """From the wheels to the action, each wheel in [-1, 1]."""
    nodes = full_speed_nodes("wheels", "fast_wheels") if keeps_turns else []
    wheels = "fast_wheels" if keeps_turns else "wheels"
    if for_armv6:
        clip = helper.make_node("Clip", [wheels], [OUTPUT_NAME], "clip", min=-1.0, max=1.0)
    else:
        clip = helper.make_node("Clip", [wheels, "backward", "forward"], [OUTPUT_NAME], "clip")
    return [*nodes, clip]


def _put_outputs_first(nodes: list[onnx.NodeProto], constants: dict[str, NDArray[Any]]) -> None:
    """Give all weights of dense layers the shape (outputs, inputs), the only one OpenCV 4.6 reads
    with a bias.
    """
    for node in nodes:
        if node.op_type == "Gemm" and not node.attribute:
            constants[node.input[1]] = np.ascontiguousarray(constants[node.input[1]].T)
            node.attribute.append(helper.make_attribute("transB", 1))


def _gemm(source: str, name: str) -> onnx.NodeProto:
    inputs = [source, f"{name}.weight", f"{name}.bias"]
    return helper.make_node("Gemm", inputs, [name], name=name, transB=1)


def _floats(name: str, *shape: int | str) -> onnx.ValueInfoProto:
    return helper.make_tensor_value_info(name, TensorProto.FLOAT, list(shape))


def _layer(
    kind: str, source: str, name: str, **attributes: int | list[int]
) -> list[onnx.NodeProto]:
    """A layer with its LeakyReLU, whose output is `<name>_active`."""
    node = helper.make_node(kind, [source, f"{name}.weight", f"{name}.bias"], [name], name=name)
    node.attribute.extend(helper.make_attribute(key, value) for key, value in attributes.items())
    return [node, _active(name)]


def _active(name: str) -> onnx.NodeProto:
    active = f"{name}_active"
    return helper.make_node("LeakyRelu", [name], [active], name=active, alpha=LEAKY_SLOPE)


def _convolutions(weights: Mapping[str, torch.Tensor], for_armv6: bool) -> list[onnx.NodeProto]:
    """From "planes" to "flat"."""
    side = weights[f"{_ORIGINS['first']}.weight"].shape[-1]
    strides = {"strides": [first_stride(side)] * 2}
    nodes = _layer("Conv", "planes", "first", **_kernel(for_armv6, side), **strides)
    halves = {**_kernel(for_armv6, 4), "strides": [2, 2]}
    rounds = {**_kernel(for_armv6, 3), **_MARGIN}
    if f"{_ORIGINS['near.inner']}.weight" in weights:
        last = "fourth_active"
        nodes += [
            *_layer("Conv", "first_active", "second", **halves, **_MARGIN),
            *_block("second_active", "near", rounds),
            *_layer("Conv", "near_active", "third", **halves, **_MARGIN),
            *_block("third_active", "far", rounds),
            *_layer("Conv", "far_active", "fourth", **halves, **_MARGIN),
        ]
    else:
        last, deeper = "view", f"{_ORIGINS['third']}.weight" in weights
        nodes += [
            *_layer("Conv", "first_active", "second", **halves),
            *_more(deeper, "Conv", "second_active", "third", last, **rounds),
        ]
    return [*nodes, helper.make_node("Flatten", [last], ["flat"], name="flat", axis=1)]


_MARGIN = {"pads": [1, 1, 1, 1]}


def _block(source: str, name: str, rounds: dict[str, list[int]]) -> list[onnx.NodeProto]:
    """Two convolutions that are added to their input; the output is `<name>_active`."""
    inner, outer = f"{name}.inner", f"{name}.outer"
    return [
        *_layer("Conv", source, inner, **rounds),
        *_layer("Conv", f"{inner}_active", outer, **rounds)[:1],
        helper.make_node("Add", [source, outer], [name], name=name),
        _active(name),
    ]


def _more(
    there: bool, kind: str, source: str, name: str, result: str, **attributes: int | list[int]
) -> list[onnx.NodeProto]:
    """A layer that is added to its own input; without it the result is the input."""
    if not there:
        return [helper.make_node("Identity", [source], [result], name=result)]
    layer = _layer(kind, source, name, **attributes)
    return [*layer, helper.make_node("Add", [source, f"{name}_active"], [result], name=result)]


def _constants(weights: Mapping[str, torch.Tensor]) -> dict[str, NDArray[Any]]:
    arrays: dict[str, NDArray[Any]] = {
        f"{name}.{part}": _array(weights[f"{origin}.{part}"])
        for name, origin in _ORIGINS.items()
        for part in ("weight", "bias")
        if f"{origin}.{part}" in weights
    }
    # Raw pixels go into the first convolution; scaling and shifting them is in its weights.
    first = arrays["first.weight"]
    arrays["first.bias"] = arrays["first.bias"] + np.float32(PIXEL_SHIFT) * first.sum((1, 2, 3))
    arrays["first.weight"] = first * np.float32(PIXEL_SCALE)
    return arrays


def _has_memory(weights: Mapping[str, torch.Tensor]) -> bool:
    return "memory.weight_hh" in weights


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
        for name, origin in _ORIGINS.items()
        for part in ("weight", "bias")
        if f"{name}.{part}" in arrays
    }
    if "beyond.weight" in arrays:
        found[KEEPS_TURNS] = np.ones((), np.float32)
    found |= {f"memory.{part}": value for part, value in memory_parts(arrays).items()}
    return {name: torch.from_numpy(value.copy()) for name, value in found.items()}


def _array(tensor: torch.Tensor) -> NDArray[np.float32]:
    return np.ascontiguousarray(tensor.detach().cpu().numpy(), np.float32)
