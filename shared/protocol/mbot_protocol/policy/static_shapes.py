"""Does every tensor of a model have the same size whatever the picture? Found out in its bytes.

The inputs' shapes are fixed. Of the operators allowed, all but a few make a tensor whose shape
follows from those of their inputs. The few take a shape, axes or positions as an input of their
own: where that is a constant, or made of constants and shapes alone, the result's shape is fixed
too, and so, by induction over the nodes in their order, are all.
"""

from mbot_protocol.errors import ContractError
from mbot_protocol.policy.policy_contract import INPUT_NAMES
from mbot_protocol.wire.wire_fields import LENGTH, fields

SHAPING = {
    "Reshape": (1,),
    "Slice": (1, 2, 3, 4),
    "Split": (1,),
    "Squeeze": (1,),
    "Unsqueeze": (1,),
} | {
    f"Reduce{kind}": (1,)
    for kind in "L1 L2 LogSum LogSumExp Max Mean Min Prod Sum SumSquare".split()  # noqa: SIM905
}
"""Inputs, by operator, whose values decide the shape of the result (ONNX operator schemas)."""

_KNOWN_WHATEVER_GOES_IN = ("Shape",)

# Field numbers of onnx.proto3.
_MODEL_GRAPH, _GRAPH_NODE, _GRAPH_INITIALIZER, _TENSOR_NAME = 7, 1, 5, 8
_NODE_INPUT, _NODE_OUTPUT, _NODE_OPERATOR = 1, 2, 4


def check_static_shapes(data: bytes) -> None:
    """Check a whole ONNX file that `check_structure` has let through.

    Raises:
        ContractError: the size of some tensor may depend on the picture, or that can't be told.

    """
    known: set[str] = set()
    made: set[str] = set(INPUT_NAMES)
    nodes: list[memoryview] = []
    for graph in _contents(memoryview(data), _MODEL_GRAPH):
        for tensor in _contents(graph, _GRAPH_INITIALIZER):
            known |= _names(tensor, _TENSOR_NAME)
        nodes += _contents(graph, _GRAPH_NODE)
    if known & made:
        raise ContractError(f"the model has weights of the name {min(known & made)!r}")
    made |= known
    for node in nodes:
        operator = "".join(_names(node, _NODE_OPERATOR))
        inputs = [_text(one) for one in _contents(node, _NODE_INPUT)]
        outputs = _names(node, _NODE_OUTPUT) - {""}
        if twice := outputs & made:
            raise ContractError(f"the model makes {min(twice)[:80]!r} twice")
        made |= outputs
        for index in SHAPING.get(operator, ()):
            if index < len(inputs) and inputs[index] and inputs[index] not in known:
                raise ContractError(
                    f"the size of what {operator} makes ({', '.join(sorted(outputs))[:80]}) may "
                    "depend on the picture: export a network in which none does"
                )
        if operator in _KNOWN_WHATEVER_GOES_IN or known.issuperset(filter(None, inputs)):
            known |= outputs


def _contents(message: memoryview, number: int) -> list[memoryview]:
    return [
        content
        for found, wire_type, _, content in fields(message)
        if found == number and wire_type == LENGTH
    ]


def _names(message: memoryview, number: int) -> set[str]:
    return {_text(content) for content in _contents(message, number)}


def _text(content: memoryview) -> str:
    return content.tobytes().decode(errors="replace")
