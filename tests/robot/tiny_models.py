"""Small ONNX models for tests: a fixed action, or one defect each."""

import numpy as np
from onnx import TensorProto, helper, numpy_helper

from mbot_protocol.policy.policy_contract import PolicyMetadata


def constant_model(
    left: float = 0.5,
    right: float = 0.5,
    *,
    name: str = "constant",
    input_name: str = "observation",
    input_shape: tuple[int | str, ...] = (1, 64, 64, 3),
    input_type: int = TensorProto.UINT8,
    metadata: dict[str, str] | None = None,
    decision_rate_hz: float = 2.5,
    extra_operator: str = "",
) -> bytes:
    """A model that always answers (left, right), whatever it sees; NaN included."""
    axes = list(range(1, len(input_shape)))
    nodes = [
        helper.make_node("Cast", [input_name], ["float"], to=TensorProto.FLOAT),
        helper.make_node("ReduceMean", ["float"], ["mean"], axes=axes, keepdims=0),
        helper.make_node("Unsqueeze", ["mean", "one"], ["column"]),
        helper.make_node("Mul", ["column", "zero"], ["nothing"]),
        helper.make_node("Add", ["nothing", "answer"], ["action"]),
    ]
    if extra_operator:
        nodes.append(helper.make_node(extra_operator, ["one"], ["unused"]))
    graph = helper.make_graph(
        nodes,
        name,
        [helper.make_tensor_value_info(input_name, input_type, input_shape)],
        [helper.make_tensor_value_info("action", TensorProto.FLOAT, (1, 2))],
        [
            numpy_helper.from_array(np.array([1], np.int64), "one"),
            numpy_helper.from_array(np.zeros((1, 2), np.float32), "zero"),
            numpy_helper.from_array(np.array([[left, right]], np.float32), "answer"),
        ],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    if metadata is None:
        metadata = PolicyMetadata(name, decision_rate_hz=decision_rate_hz).to_properties()
    helper.set_model_props(model, metadata)
    return model.SerializeToString()


def counting_model(name: str = "counting") -> bytes:
    """A model with memory: left says an eighth of the decisions it remembers, right what the left
    wheel was told before.
    """
    nodes = [
        helper.make_node("Add", ["state_in", "one"], ["state_out"]),
        helper.make_node("Squeeze", ["state_in", "axis"], ["count"]),
        helper.make_node("Mul", ["count", "eighth"], ["left"]),
        helper.make_node("Gather", ["previous_action", "axis"], ["right"], axis=1),
        helper.make_node("Concat", ["left", "right"], ["action"], axis=1),
        # Bookworm's OpenCV fails where a model does not look at its picture at all.
        helper.make_node("Cast", ["observation"], ["unused"], to=TensorProto.FLOAT),
    ]
    constants = {
        "one": np.ones((1, 1, 1), np.float32),
        "eighth": np.full((1, 1), 0.125, np.float32),
        "axis": np.array([0], np.int64),
    }
    state, pair = (1, 1, 1), (1, 2)
    graph = helper.make_graph(
        nodes,
        name,
        [
            helper.make_tensor_value_info("observation", TensorProto.UINT8, (1, 64, 64, 3)),
            helper.make_tensor_value_info("previous_action", TensorProto.FLOAT, pair),
            helper.make_tensor_value_info("state_in", TensorProto.FLOAT, state),
        ],
        [
            helper.make_tensor_value_info("action", TensorProto.FLOAT, pair),
            helper.make_tensor_value_info("state_out", TensorProto.FLOAT, state),
        ],
        [numpy_helper.from_array(value, key) for key, value in constants.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    helper.set_model_props(model, PolicyMetadata(name, contract_version=2).to_properties())
    return model.SerializeToString()


def seeing_model(name: str = "seeing") -> bytes:
    """A model with memory that looks: random weights between picture, memory and wheels."""
    noise = np.random.default_rng(5)
    nodes = [
        helper.make_node("Cast", ["observation"], ["float"], to=TensorProto.FLOAT),
        helper.make_node("Transpose", ["float"], ["planes"], perm=[0, 3, 1, 2]),
        helper.make_node(
            "AveragePool", ["planes"], ["small"], kernel_shape=[16, 16], strides=[16, 16]
        ),
        helper.make_node("Flatten", ["small"], ["row"]),
        helper.make_node("Squeeze", ["state_in", "first"], ["before"]),
        helper.make_node("Concat", ["row", "before", "previous_action"], ["known"], axis=1),
        helper.make_node("Gemm", ["known", "weights"], ["sum"]),
        helper.make_node("Tanh", ["sum"], ["after"]),
        helper.make_node("Unsqueeze", ["after", "first"], ["state_out"]),
        helper.make_node("Gemm", ["after", "wheels"], ["action"]),
    ]
    weights = noise.normal(0, 1, (48 + 8 + 2, 8)).astype(np.float32)
    weights[:48] /= 400
    constants = {
        "first": np.array([0], np.int64),
        "weights": weights,
        "wheels": noise.normal(0, 0.4, (8, 2)).astype(np.float32),
    }
    state, pair = (1, 1, 8), (1, 2)
    value = helper.make_tensor_value_info
    graph = helper.make_graph(
        nodes,
        name,
        [
            value("observation", TensorProto.UINT8, (1, 64, 64, 3)),
            value("previous_action", TensorProto.FLOAT, pair),
            value("state_in", TensorProto.FLOAT, state),
        ],
        [value("action", TensorProto.FLOAT, pair), value("state_out", TensorProto.FLOAT, state)],
        [numpy_helper.from_array(value, key) for key, value in constants.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    helper.set_model_props(model, PolicyMetadata(name, contract_version=2).to_properties())
    return model.SerializeToString()
