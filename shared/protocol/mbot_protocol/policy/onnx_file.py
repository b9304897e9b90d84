"""An ONNX file's bytes, read without any library that could be harmed by them, and not copied.

`fields` goes through any protobuf message; `read_onnx` says what a file declares and is made of.
"""

from collections.abc import Iterator
from dataclasses import dataclass

from mbot_protocol.errors import ContractError
from mbot_protocol.policy.policy_contract import Tensor

VARINT, FIXED64, LENGTH, FIXED32 = 0, 1, 2, 5

_LONGEST_VARINT = 10

# Field numbers of onnx.proto3 (ONNX 1.18).
_MODEL_IR_VERSION, _MODEL_GRAPH, _MODEL_OPSET, _MODEL_METADATA = 1, 7, 8, 14
_OPSET_DOMAIN, _OPSET_VERSION = 1, 2
_GRAPH_NODE, _GRAPH_INITIALIZER, _GRAPH_INPUT, _GRAPH_OUTPUT = 1, 5, 11, 12
_NODE_INPUT, _NODE_OUTPUT, _NODE_OPERATOR = 1, 2, 4
_TENSOR_NAME, _VALUE_NAME, _VALUE_TYPE, _TYPE_TENSOR = 8, 1, 2, 1
_ELEMENT_TYPE, _SHAPE, _DIMENSION, _SIZE, _SYMBOL = 1, 2, 1, 1, 2
_ENTRY_KEY, _ENTRY_VALUE = 1, 2

_KINDS = (
    *("undefined", "float32", "uint8", "int8", "uint16", "int16", "int32", "int64", "string"),
    *("bool", "float16", "float64", "uint32", "uint64"),
)
"""Of TensorProto.DataType, by number, as numpy names them."""


@dataclass(frozen=True, slots=True)
class Node:
    """One operation: its operator, and the names of what goes in and comes out."""

    operator: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class OnnxFile:
    """What a file declares and is made of, all in the file's order.

    Attributes:
        ir_version: of the format.
        opset: version of ONNX's own operators; 0: none is named.
        properties: its metadata.
        inputs, outputs: without weights, which old files list among the inputs.
        weights: their names.
        nodes: of the graph.

    """

    ir_version: int
    opset: int
    properties: dict[str, str]
    inputs: tuple[Tensor, ...]
    outputs: tuple[Tensor, ...]
    weights: frozenset[str]
    nodes: tuple[Node, ...]


def read_onnx(data: bytes) -> OnnxFile:
    """Read a file, whatever it is made of; `model_structure.py` judges that.

    Raises:
        ContractError: it is not a protobuf message, or damaged.

    """
    model = memoryview(data)
    graphs = list(_messages(model, _MODEL_GRAPH))
    weights = {
        _text(one, _TENSOR_NAME) for graph in graphs for one in _messages(graph, _GRAPH_INITIALIZER)
    }
    opsets = [
        _number(one, _OPSET_VERSION) or 0
        for one in _messages(model, _MODEL_OPSET)
        if not _text(one, _OPSET_DOMAIN)
    ]
    inputs = [_tensor(one) for graph in graphs for one in _messages(graph, _GRAPH_INPUT)]
    return OnnxFile(
        _number(model, _MODEL_IR_VERSION) or 0,
        max(opsets, default=0),
        {
            _text(entry, _ENTRY_KEY): _text(entry, _ENTRY_VALUE)
            for entry in _messages(model, _MODEL_METADATA)
        },
        tuple(tensor for tensor in inputs if tensor.name not in weights),
        tuple(_tensor(one) for graph in graphs for one in _messages(graph, _GRAPH_OUTPUT)),
        frozenset(weights),
        tuple(_node(one) for graph in graphs for one in _messages(graph, _GRAPH_NODE)),
    )


def fields(data: memoryview) -> Iterator[tuple[int, int, int, memoryview]]:
    """Each field in order: number, wire type, value of a varint, content of anything else.

    Raises:
        ContractError: the bytes are not a protobuf message.

    """
    position = 0
    while position < len(data):
        tag, position = _varint(data, position)
        number, wire_type = tag >> 3, tag & 7
        if number == 0:
            raise ContractError("this is not an ONNX model: a field has number 0")
        if wire_type == VARINT:
            value, position = _varint(data, position)
            yield number, wire_type, value, data[:0]
            continue
        if wire_type == LENGTH:
            length, position = _varint(data, position)
        elif wire_type in (FIXED64, FIXED32):
            length = 8 if wire_type == FIXED64 else 4
        else:
            raise ContractError(f"this is not an ONNX model: a field has wire type {wire_type}")
        if length > len(data) - position:
            raise ContractError("the ONNX data is truncated or damaged")
        yield number, wire_type, 0, data[position : position + length]
        position += length


def varints(data: memoryview) -> Iterator[int]:
    """The values of a packed repeated field; raises as `fields`."""
    position = 0
    while position < len(data):
        value, position = _varint(data, position)
        yield value


def _varint(data: memoryview, position: int) -> tuple[int, int]:
    value = 0
    for index in range(_LONGEST_VARINT):
        if position + index >= len(data):
            raise ContractError("the ONNX data is truncated or damaged")
        byte = data[position + index]
        value |= (byte & 0x7F) << (7 * index)
        if byte < 0x80:
            return value & 0xFFFF_FFFF_FFFF_FFFF, position + index + 1
    raise ContractError("this is not an ONNX model: a number has more than 10 bytes")


def _node(data: memoryview) -> Node:
    inputs = tuple(map(_decoded, _messages(data, _NODE_INPUT)))
    outputs = tuple(map(_decoded, _messages(data, _NODE_OUTPUT)))
    return Node(_text(data, _NODE_OPERATOR), inputs, outputs)


def _tensor(value: memoryview) -> Tensor:
    kind, shape = "", tuple[object, ...]()
    for declared in _messages(value, _VALUE_TYPE):
        for tensor in _messages(declared, _TYPE_TENSOR):
            number = _number(tensor, _ELEMENT_TYPE) or 0
            kind = _KINDS[number] if number < len(_KINDS) else f"element type {number}"
            for dimensions in _messages(tensor, _SHAPE):
                shape = tuple(map(_dimension, _messages(dimensions, _DIMENSION)))
    return Tensor(_text(value, _VALUE_NAME), kind, shape)


def _dimension(data: memoryview) -> object:
    """A number, or a name where it is symbolic; "?" has neither."""
    size = _number(data, _SIZE)
    return _text(data, _SYMBOL) or ("?" if size is None else size)


def _messages(data: memoryview, number: int) -> Iterator[memoryview]:
    return (
        content
        for found, wire_type, _, content in fields(data)
        if found == number and wire_type == LENGTH
    )


def _text(data: memoryview, number: int) -> str:
    """The last of that number, as protobuf has it; empty if there is none."""
    text = ""
    for content in _messages(data, number):
        text = _decoded(content)
    return text


def _decoded(content: memoryview) -> str:
    return content.tobytes().decode(errors="replace")


def _number(data: memoryview, number: int) -> int | None:
    found = [value for at, kind, value, _ in fields(data) if at == number and kind == VARINT]
    return found[-1] if found else None
