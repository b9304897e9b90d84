"""The fields of a protobuf message in their bytes, without its schema and without copying."""

from collections.abc import Iterator

from mbot_protocol.errors import ContractError

VARINT, FIXED64, LENGTH, FIXED32 = 0, 1, 2, 5

_LONGEST_VARINT = 10


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
