"""A model whose tensors could grow with the picture is refused; all that we export is not."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from mbot_protocol.errors import ContractError
from mbot_protocol.policy.model_structure import OPERATORS
from mbot_protocol.policy.policy_contract import PolicyMetadata
from mbot_protocol.policy.static_shapes import SHAPING, check_static_shapes
from mbot_workstation.fleet.models.servo_policy import ServoGains, servo_model

from ..robot.tiny_models import constant_model

TRAINED = Path(__file__).parents[2] / "models" / "red-cube.onnx"


def model(*nodes: onnx.NodeProto, weights: Sequence[TensorProto] = ()) -> bytes:
    view = helper.make_tensor_value_info("observation", TensorProto.UINT8, [1, 64, 64, 3])
    answer = helper.make_tensor_value_info("action", TensorProto.FLOAT, [1, 2])
    graph = helper.make_graph(list(nodes), "g", [view], [answer], list(weights))
    return helper.make_model(graph).SerializeToString()


def weight(name: str, *values: int) -> TensorProto:
    return numpy_helper.from_array(np.array(values, np.int64), name)


BRIGHTEST = [
    helper.make_node("Cast", ["observation"], ["whole"], to=TensorProto.INT64),
    helper.make_node("ReduceMax", ["whole"], ["level"], keepdims=0),
    helper.make_node("Reshape", ["level", "one"], ["levels"]),
]
"""A number of the picture, as a tensor of one element."""


def test_our_own_models_pass() -> None:
    servo = servo_model(ServoGains(), PolicyMetadata("servo")).SerializeToString()
    for data in (constant_model(), servo, TRAINED.read_bytes()):
        check_static_shapes(data)


@pytest.mark.parametrize(
    "shaped",
    [
        helper.make_node("Slice", ["big", "zero", "levels"], ["x"]),
        helper.make_node("Slice", ["big", "levels", "one"], ["x"]),
        helper.make_node("Slice", ["big", "zero", "one", "levels"], ["x"]),
        helper.make_node("Reshape", ["big", "levels"], ["x"]),
        helper.make_node("Split", ["big", "levels"], ["x", "y"]),
        helper.make_node("ReduceSum", ["big", "levels"], ["x"]),
        helper.make_node("Unsqueeze", ["big", "levels"], ["x"]),
    ],
    ids=lambda node: f"{node.op_type} {' '.join(node.input)}",
)
def test_a_size_that_depends_on_the_picture_is_refused(shaped: onnx.NodeProto) -> None:
    weights = [weight("one", 1), weight("zero", 0), weight("big", *range(6400))]
    with pytest.raises(ContractError, match=f"of what {shaped.op_type} makes .* on the picture"):
        check_static_shapes(model(*BRIGHTEST, shaped, weights=weights))


def test_shapes_made_of_constants_and_shapes_are_fixed() -> None:
    """As torch writes `x.reshape(x.shape[0], -1)`."""
    nodes = [
        helper.make_node("Shape", ["observation"], ["shape"]),
        helper.make_node("Gather", ["shape", "zero"], ["batch"]),
        helper.make_node("Concat", ["batch", "rest"], ["flat_shape"], axis=0),
        helper.make_node("Reshape", ["observation", "flat_shape"], ["flat"]),
    ]
    check_static_shapes(model(*nodes, weights=[weight("zero", 0), weight("rest", -1)]))


@pytest.mark.parametrize("name", ["one", "observation", "level"])
def test_nothing_is_what_it_is_not(name: str) -> None:
    """A node that makes anew what counts as a constant, or the picture."""
    again = helper.make_node("Identity", ["level"], [name])
    with pytest.raises(ContractError, match="twice"):
        check_static_shapes(model(*BRIGHTEST, again, weights=[weight("one", 1)]))


def test_weights_in_place_of_the_picture_are_refused() -> None:
    with pytest.raises(ContractError, match="weights of the name 'observation'"):
        check_static_shapes(model(weights=[weight("observation", 1)]))


def test_every_operator_that_takes_a_shape_is_known() -> None:
    """Held to ONNX: an input called shape, axes, starts, ends, steps or split decides a shape."""
    deciding = {"shape", "axes", "starts", "ends", "steps", "split", "sizes", "repeats", "pads"}
    schemas = [s for s in onnx.defs.get_all_schemas_with_history() if s.name in OPERATORS]
    for schema in schemas:
        found = {index for index, one in enumerate(schema.inputs) if one.name in deciding}
        assert found <= set(SHAPING.get(schema.name, ())), schema.name
    assert set(SHAPING) <= OPERATORS
