"""The memory in a policy's graph: one step of a GRU, as one operator or spelt out.

    features, previous_action, state_in -> known (the features and the new state), state_out

Weights are by torch's names and in its order of gates: reset, update, new. Shapes for n units:
weight_ih [3 n, features], weight_hh [3 n, n], bias_ih and bias_hh [3 n].
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import helper

from mbot_protocol.policy.policy_contract import PREVIOUS_ACTION_NAME, STATE_IN_NAME, STATE_OUT_NAME

Array = NDArray[np.float32]

FEATURES = "features"
"""What the network makes of a picture."""

PARTS = ("weight_ih", "weight_hh", "bias_ih", "bias_hh")


@dataclass(frozen=True, slots=True, eq=False)
class MemoryGraph:
    """Nodes from the features and the state to `known` and the new state, and their constants."""

    nodes: list[onnx.NodeProto]
    constants: dict[str, NDArray[np.float32] | NDArray[np.int64]]


def gru(parts: Mapping[str, Array]) -> MemoryGraph:
    """By ONNX's own operator, for any batch. `parts` are weights as above, by name."""
    ordered = {name: _update_first(parts[name])[None] for name in PARTS}
    inputs = ["moment", "memory.input", "memory.recurrent", "memory.bias", "", STATE_IN_NAME]
    nodes = [
        _met(),
        helper.make_node("Unsqueeze", ["met", "first_axis"], ["moment"], "moment"),
        helper.make_node(
            "GRU",
            inputs,
            ["", STATE_OUT_NAME],
            "memory",
            hidden_size=_units(parts),
            linear_before_reset=1,  # as torch
        ),
        helper.make_node("Squeeze", [STATE_OUT_NAME, "first_axis"], ["recalled"], "recalled"),
        _known(),
    ]
    return MemoryGraph(
        nodes,
        {
            "memory.input": ordered["weight_ih"],
            "memory.recurrent": ordered["weight_hh"],
            "memory.bias": np.concatenate([ordered["bias_ih"], ordered["bias_hh"]], axis=1),
            "first_axis": np.array([0], np.int64),
        },
    )


def spelt_out_gru(parts: Mapping[str, Array]) -> MemoryGraph:
    """By operators that OpenCV 4.6 knows, of operator set 10 and for one picture a batch.

    OpenCV's GRU takes no first state. `parts` are as for `gru`.
    """
    thirds = [_units(parts)] * 3
    gates = ("reset", "update", "new")

    def node(kind: str, inputs: list[str], output: str) -> onnx.NodeProto:
        return helper.make_node(kind, inputs, [output], name=output)

    def weighed(source: str, suffix: str, out: str) -> list[onnx.NodeProto]:
        weights = [f"memory.weight_{suffix}", f"memory.bias_{suffix}"]
        each = [f"{out}_{gate}" for gate in gates]
        return [
            helper.make_node("Gemm", [source, *weights], [out], name=out, transB=1),
            helper.make_node("Split", [out], each, name=f"{out}_gates", axis=1, split=thirds),
        ]

    before = helper.make_node("Squeeze", [STATE_IN_NAME], ["before"], "before", axes=[0])
    after = helper.make_node("Unsqueeze", ["recalled"], [STATE_OUT_NAME], "after", axes=[0])
    nodes = [
        _met(),
        before,
        *weighed("met", "ih", "seen"),
        *weighed("before", "hh", "held"),
        node("Add", ["seen_reset", "held_reset"], "reset_sum"),
        node("Sigmoid", ["reset_sum"], "reset"),
        node("Add", ["seen_update", "held_update"], "update_sum"),
        node("Sigmoid", ["update_sum"], "update"),
        node("Mul", ["reset", "held_new"], "held_on"),
        node("Add", ["seen_new", "held_on"], "new_sum"),
        node("Tanh", ["new_sum"], "new"),
        # (1 - update) new + update before
        node("Sub", ["before", "new"], "difference"),
        node("Mul", ["update", "difference"], "kept"),
        node("Add", ["new", "kept"], "recalled"),
        after,
        _known(),
    ]
    return MemoryGraph(nodes, {f"memory.{name}": parts[name] for name in PARTS})


def memory_parts(constants: Mapping[str, Array]) -> dict[str, Array]:
    """The way back: weights by torch's names from a graph's constants; none without a memory."""
    if "memory.weight_ih" in constants:
        return {name: constants[f"memory.{name}"] for name in PARTS}
    if "memory.bias" not in constants:
        return {}
    biases = np.split(constants["memory.bias"][0], 2)
    parts = (constants["memory.input"][0], constants["memory.recurrent"][0], *biases)
    return {name: _update_first(part) for name, part in zip(PARTS, parts, strict=True)}


def _met() -> onnx.NodeProto:
    inputs = [FEATURES, PREVIOUS_ACTION_NAME]
    return helper.make_node("Concat", inputs, ["met"], "met", axis=1)


def _known() -> onnx.NodeProto:
    return helper.make_node("Concat", [FEATURES, "recalled"], ["known"], "known", axis=1)


def _units(parts: Mapping[str, Array]) -> int:
    return int(parts["weight_hh"].shape[1])


def _update_first(gates: Array) -> Array:
    """Torch's gates (reset, update, new) in ONNX's order (update, reset, new), or back again."""
    reset, update, new = np.split(gates, 3)
    return np.concatenate([update, reset, new])
