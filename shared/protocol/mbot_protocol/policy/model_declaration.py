"""What an ONNX file declares: inputs, outputs and metadata, read from its bytes.

For engines that do not tell; onnxruntime does.
"""

from dataclasses import dataclass

from mbot_protocol.policy.policy_contract import Tensor
from mbot_protocol.wire.wire_fields import LENGTH, VARINT, fields

# Field numbers of onnx.proto3.
_MODEL_GRAPH, _MODEL_METADATA = 7, 14
_GRAPH_INITIALIZER, _GRAPH_INPUT, _GRAPH_OUTPUT = 5, 11, 12
_TENSOR_NAME, _VALUE_NAME, _VALUE_TYPE, _TYPE_TENSOR = 8, 1, 2, 1
_ELEMENT_TYPE, _SHAPE, _DIMENSION, _SIZE, _SYMBOL = 1, 2, 1, 1, 2
_ENTRY_KEY, _ENTRY_VALUE = 1, 2

_KINDS = {1: "float32", 2: "uint8"}
"""Of TensorProto.DataType, what the contract has."""


@dataclass(frozen=True, slots=True)
class ModelDeclaration:
    """Inputs and outputs in the file's order, and its metadata properties."""

    inputs: tuple[Tensor, ...]
    outputs: tuple[Tensor, ...]
    properties: dict[str, str]


def read_declaration(data: bytes) -> ModelDeclaration:
    """Read what a file declares that `check_structure` has let through.

    Raises:
        ContractError: it is damaged.

    """
    inputs: list[Tensor] = []
    outputs: list[Tensor] = []
    weights: set[str] = set()
    for graph in _messages(memoryview(data), _MODEL_GRAPH):
        inputs += map(_tensor, _messages(graph, _GRAPH_INPUT))
        outputs += map(_tensor, _messages(graph, _GRAPH_OUTPUT))
        weights |= {_text(tensor, _TENSOR_NAME) for tensor in _messages(graph, _GRAPH_INITIALIZER)}
    properties = {
        _text(entry, _ENTRY_KEY): _text(entry, _ENTRY_VALUE)
        for entry in _messages(memoryview(data), _MODEL_METADATA)
    }
    # Old files list their weights among the inputs.
    pictures = tuple(tensor for tensor in inputs if tensor.name not in weights)
    return ModelDeclaration(pictures, tuple(outputs), properties)


def _tensor(value: memoryview) -> Tensor:
    kind, shape = "", list[object]()
    for declared in _messages(value, _VALUE_TYPE):
        for tensor in _messages(declared, _TYPE_TENSOR):
            number = _number(tensor, _ELEMENT_TYPE)
            kind = _KINDS.get(number, f"type {number}")
            for dimensions in _messages(tensor, _SHAPE):
                shape = [_dimension(one) for one in _messages(dimensions, _DIMENSION)]
    return Tensor(_text(value, _VALUE_NAME), kind, tuple(shape))


def _dimension(data: memoryview) -> object:
    symbol = _text(data, _SYMBOL)
    return symbol or _number(data, _SIZE)


def _messages(data: memoryview, number: int) -> list[memoryview]:
    return [
        content
        for found, wire_type, _, content in fields(data)
        if found == number and wire_type == LENGTH
    ]


def _text(data: memoryview, number: int) -> str:
    return "".join(part.tobytes().decode(errors="replace") for part in _messages(data, number)[-1:])


def _number(data: memoryview, number: int) -> int:
    found = [value for at, kind, value, _ in fields(data) if at == number and kind == VARINT]
    return found[-1] if found else 0
