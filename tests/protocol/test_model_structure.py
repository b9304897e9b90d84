"""Against the onnx package: what our walk lets through, its parser must find harmless too."""

import contextlib
import random
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import onnx
import pytest
from google.protobuf.message import DecodeError
from hypothesis import given, settings
from hypothesis import strategies as st
from onnx import TensorProto, defs, helper, numpy_helper

from mbot_protocol.errors import ContractError
from mbot_protocol.policy.model_structure import MOST_FIELDS, OPERATORS, SHAPING, check_structure
from mbot_protocol.policy.onnx_file import fields, varints
from mbot_protocol.policy.policy_contract import LARGEST_MODEL_BYTES, PolicyMetadata
from mbot_workstation.fleet.models.servo_policy import ServoGains, servo_model

from ..robot.tiny_models import constant_model

TRAINED = Path(__file__).parents[2] / "models" / "red-cube.onnx"
SERVO = servo_model(ServoGains(), PolicyMetadata("servo")).SerializeToString()
GOOD = constant_model()


def changed(change: Callable[[onnx.ModelProto], object]) -> bytes:
    model = onnx.ModelProto.FromString(GOOD)
    change(model)
    return model.SerializeToString()


def test_our_own_models_pass() -> None:
    for data in (GOOD, SERVO, TRAINED.read_bytes()):
        check_structure(data)


def test_the_operators_are_onnxs_own_and_none_of_them_holds_a_graph() -> None:
    schemas = {s.name: s for s in defs.get_all_schemas_with_history() if s.domain == ""}
    assert set(schemas) >= OPERATORS
    for name in OPERATORS:
        kinds = {attribute.type for attribute in schemas[name].attributes.values()}
        assert not kinds & {defs.OpSchema.AttrType.GRAPH, defs.OpSchema.AttrType.GRAPHS}, name


def node(kind: str, domain: str = "") -> Callable[[onnx.ModelProto], object]:
    return lambda m: m.graph.node.append(helper.make_node(kind, ["a"], ["b"], domain=domain))


def attribute(name: str, value: object) -> Callable[[onnx.ModelProto], object]:
    made = helper.make_attribute(name, value)
    return lambda m: m.graph.node[0].attribute.append(made)


def weights(change: Callable[[TensorProto], object]) -> Callable[[onnx.ModelProto], object]:
    return lambda m: change(m.graph.initializer[0])


def outside(tensor: TensorProto) -> None:
    tensor.data_location = TensorProto.EXTERNAL
    tensor.external_data.add(key="location", value="/etc/passwd")


EMPTY_GRAPH = helper.make_graph([], "inner", [], [])
TENSOR = numpy_helper.from_array(np.zeros(2, np.float32), "inside")
CONSTANT = helper.make_node("Constant", [], ["c"], value=TENSOR)


def constant_outside(model: onnx.ModelProto) -> None:
    model.graph.node.append(CONSTANT)
    outside(model.graph.node[-1].attribute[0].t)


FORBIDDEN = {
    "Loop": (node("Loop"), "'Loop'"),
    "If": (node("If"), "'If'"),
    "Scan": (node("Scan"), "'Scan'"),
    "Expand": (node("Expand"), "'Expand'"),
    "no such operator": (node("\x1b[31mEvil"), "'.x1b.31mEvil'"),
    "no operator": (lambda model: model.graph.node[0].ClearField("op_type"), "has no operator"),
    "another domain": (node("Add", "com.microsoft"), "'com.microsoft'"),
    "graph inside": (attribute("body", EMPTY_GRAPH), "a graph inside"),
    "graphs inside": (attribute("bodies", [EMPTY_GRAPH]), "graphs inside"),
    "list of tensors": (attribute("values", [TENSOR]), "a list of tensors"),
    "external data": (weights(outside), "another file"),
    "external data in a node": (constant_outside, "another file"),
    "texts": (weights(lambda t: t.string_data.append(b"x")), "texts"),
    "huge tensor": (weights(lambda t: t.dims.extend([1 << 20, 1 << 20])), "elements"),
    "negative size": (weights(lambda t: t.dims.append(-1)), "elements"),
    "function": (lambda m: m.functions.add(name="f"), "functions of its own"),
    "training": (lambda m: m.training_info.add(), "training steps"),
    "sparse weights": (lambda m: m.graph.sparse_initializer.add(), "sparse weights"),
    "too many parts": (
        lambda m: m.graph.node[0].input.extend([""] * MOST_FIELDS),
        "far too many",
    ),
}


@pytest.mark.parametrize("name", FORBIDDEN)
def test_what_no_policy_needs_is_refused_by_name(name: str) -> None:
    change, words = FORBIDDEN[name]
    with pytest.raises(ContractError, match=words) as caught:
        check_structure(changed(change))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "data",
    [b"", b"no model", bytes(100), b"\x08", b"\x0a\xff\xff\xff\xff\x0f", b"\x80" * 11, b"\x0b\x0c"],
)
def test_what_is_no_onnx_is_refused(data: bytes) -> None:
    with pytest.raises(ContractError):
        check_structure(data)


def test_bytes_that_are_also_onnxruntimes_own_format_count_as_onnx() -> None:
    both = b"\x08\x08\x12\x08ORTM1234" + GOOD
    check_structure(both)  # `Policy` tells onnxruntime to read them as ONNX, and only that
    assert onnx.ModelProto.FromString(both).producer_name == "ORTM1234"


def assert_harmless(model: onnx.ModelProto) -> None:
    assert not model.functions
    assert not model.training_info
    assert not model.graph.sparse_initializer
    tensors = list(model.graph.initializer)
    for one in model.graph.node:
        assert one.op_type in OPERATORS
        assert one.domain in ("", "ai.onnx")
        for part in one.attribute:
            assert not part.HasField("g")
            assert not part.graphs
            assert not part.tensors
            assert not part.HasField("sparse_tensor")
            tensors += [part.t] if part.HasField("t") else []
    for tensor in tensors:
        assert tensor.data_location == TensorProto.DEFAULT
        assert not tensor.external_data
        assert np.prod([float(size) for size in tensor.dims]) <= LARGEST_MODEL_BYTES


SEEDS = [GOOD, SERVO] + [
    changed(change) for name, (change, _) in FORBIDDEN.items() if "too" not in name
]


@settings(max_examples=600)
@given(st.sampled_from(SEEDS), st.randoms(use_true_random=False), st.integers(1, 4))
def test_whatever_passes_is_harmless_as_onnx_reads_it(
    data: bytes, source: random.Random, changes: int
) -> None:
    mutated = bytearray(data)
    for _ in range(changes):
        where = source.randrange(len(mutated))
        match source.randrange(4):
            case 0:
                mutated[where] = source.randrange(256)
            case 1:
                mutated[where:where] = source.randbytes(source.randrange(1, 4))
            case 2:
                del mutated[where : where + source.randrange(1, 4)]
            case _:
                there = source.randrange(len(mutated))
                mutated[where:where] = mutated[there : there + source.randrange(1, 60)]
    try:
        check_structure(bytes(mutated))
    except ContractError:
        return
    with contextlib.suppress(DecodeError):
        assert_harmless(onnx.ModelProto.FromString(bytes(mutated)))


@given(st.binary(max_size=200))
def test_garbage_never_crashes_the_walk(data: bytes) -> None:
    with contextlib.suppress(ContractError):
        check_structure(data)
    with contextlib.suppress(ContractError):
        list(fields(memoryview(data)))


@given(st.lists(st.integers(0, 2**63 - 1), max_size=20))
def test_packed_numbers_are_read_as_protobuf_writes_them(values: list[int]) -> None:
    made = helper.make_attribute("ints", values, attr_type=onnx.AttributeProto.INTS)
    found: list[int] = []
    for number, kind, value, content in fields(memoryview(made.SerializeToString())):
        if number == 8:
            found += [value] if kind == 0 else list(varints(content))
    assert found == values


def network(*nodes: onnx.NodeProto, weights: Sequence[TensorProto] = ()) -> bytes:
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
        check_structure(network(*BRIGHTEST, shaped, weights=weights))


def test_shapes_made_of_constants_and_shapes_are_fixed() -> None:
    """As torch writes `x.reshape(x.shape[0], -1)`."""
    nodes = [
        helper.make_node("Shape", ["observation"], ["shape"]),
        helper.make_node("Gather", ["shape", "zero"], ["batch"]),
        helper.make_node("Concat", ["batch", "rest"], ["flat_shape"], axis=0),
        helper.make_node("Reshape", ["observation", "flat_shape"], ["flat"]),
    ]
    check_structure(network(*nodes, weights=[weight("zero", 0), weight("rest", -1)]))


@pytest.mark.parametrize("name", ["one", "observation", "level"])
def test_nothing_is_what_it_is_not(name: str) -> None:
    """A node that redefines what counts as a constant, or the picture."""
    again = helper.make_node("Identity", ["level"], [name])
    with pytest.raises(ContractError, match="twice"):
        check_structure(network(*BRIGHTEST, again, weights=[weight("one", 1)]))


def test_weights_in_place_of_the_picture_are_refused() -> None:
    with pytest.raises(ContractError, match="weights of the name 'observation'"):
        check_structure(network(weights=[weight("observation", 1)]))


def test_every_operator_that_takes_a_shape_is_known() -> None:
    """Held to ONNX: an input called shape, axes, starts, ends, steps or split decides a shape."""
    deciding = {"shape", "axes", "starts", "ends", "steps", "split", "sizes", "repeats", "pads"}
    schemas = [s for s in onnx.defs.get_all_schemas_with_history() if s.name in OPERATORS]
    for schema in schemas:
        found = {index for index, one in enumerate(schema.inputs) if one.name in deciding}
        assert found <= set(SHAPING.get(schema.name, ())), schema.name
    assert set(SHAPING) <= OPERATORS
