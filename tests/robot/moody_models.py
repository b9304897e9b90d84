"""Models that pass every trial and go wrong on a camera's pictures."""

import numpy as np
from onnx import TensorProto, helper, numpy_helper

from mbot_protocol.policy.policy_contract import PolicyMetadata

LOW, HIGH = 5.0**2, 70.0**2
"""Variances: flat pictures have 0 and independent noise, as in the dry run, 74 squared; what a
camera sees lies between."""


def breaks_on_a_cameras_picture(name: str) -> bytes:
    """Drives straight on; answers NaN where a picture is neither flat nor noise."""
    axes = [1, 2, 3]
    nodes = [
        helper.make_node("Cast", ["observation"], ["float"], to=TensorProto.FLOAT),
        helper.make_node("ReduceMean", ["float"], ["mean"], axes=axes, keepdims=1),
        helper.make_node("Sub", ["float", "mean"], ["off"]),
        helper.make_node("Mul", ["off", "off"], ["square"]),
        helper.make_node("ReduceMean", ["square"], ["variance"], axes=[2, 3], keepdims=0),
        helper.make_node("ReduceMean", ["variance"], ["spread"], axes=[1], keepdims=1),
        helper.make_node("Sub", ["spread", "low"], ["above"]),
        helper.make_node("Sub", ["spread", "high"], ["below"]),
        helper.make_node("Mul", ["above", "below"], ["outside"]),  # negative between the two
        helper.make_node("Sqrt", ["outside"], ["root"]),
        helper.make_node("Mul", ["root", "nothing"], ["zero"]),
        helper.make_node("Add", ["zero", "answer"], ["action"]),
    ]
    constants = {
        "low": np.array([[LOW]], np.float32),
        "high": np.array([[HIGH]], np.float32),
        "nothing": np.zeros((1, 2), np.float32),
        "answer": np.full((1, 2), 0.3, np.float32),
    }
    graph = helper.make_graph(
        nodes,
        name,
        [helper.make_tensor_value_info("observation", TensorProto.UINT8, (1, 64, 64, 3))],
        [helper.make_tensor_value_info("action", TensorProto.FLOAT, (1, 2))],
        [numpy_helper.from_array(values, key) for key, values in constants.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    helper.set_model_props(model, PolicyMetadata(name, decision_rate_hz=10.0).to_properties())
    return model.SerializeToString()
