"""What a model may be made of, checked in its bytes before any library reads them.

Every field of the ONNX format that a plain network needs is allowed by name; everything else,
known or not, is refused. So there are no loops and branches, no graphs inside nodes, no functions,
no operators of other domains, no weights in other files.

Nor may the size of any tensor depend on the picture, so that a trial run shows what a decision
costs. The inputs' shapes are fixed. Of the operators allowed, all but a few make a tensor whose
shape follows from those of their inputs. The few take a shape, axes or positions as an input of
their own: where that is a constant, or made of constants and shapes alone, the result's shape is
fixed too, and so, by induction over the nodes in their order, are all.
"""

from collections.abc import Callable

from mbot_protocol.errors import ContractError
from mbot_protocol.policy.onnx_file import LENGTH, VARINT, OnnxFile, fields, read_onnx, varints
from mbot_protocol.policy.policy_contract import INPUT_NAMES, LARGEST_MODEL_BYTES

OPERATORS = frozenset(
    """
    Abs Add And ArgMax ArgMin AveragePool BatchNormalization Cast Ceil Celu Clip Concat Constant
    Conv Cos Div Dropout Elu Equal Erf Exp Flatten Floor GRU Gather Gelu Gemm GlobalAveragePool
    GlobalMaxPool Greater GreaterOrEqual GroupNormalization HardSigmoid HardSwish Identity
    InstanceNormalization LRN LSTM LayerNormalization LeakyRelu Less LessOrEqual Log LogSoftmax
    LpNormalization MatMul Max MaxPool Mean Min Mish Mod Mul Neg Not Or PRelu Pow RNN Reciprocal
    ReduceL1 ReduceL2 ReduceLogSum ReduceLogSumExp ReduceMax ReduceMean ReduceMin ReduceProd
    ReduceSum ReduceSumSquare Relu Reshape Round Selu Shape Sigmoid Sign Sin Slice Softmax
    Softplus Softsign SpaceToDepth Split Sqrt Squeeze Sub Sum Tanh ThresholdedRelu Transpose
    Unsqueeze Where Xor
    """.split()  # noqa: SIM905 (87 quoted words are harder to read)
)
"""Of ONNX's own domain. Not among them: If, Loop and Scan; what draws random numbers; what makes a
tensor as large as its input says (Expand, Tile, Range, ConstantOfShape, Pad, Resize)."""

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

MOST_FIELDS = 100_000
"""Visited one by one in Python, 0.2 s; the paper's network has about 100."""

_FIRST_BYTE = b"\x08"
"""Field 1, ir_version, as a varint: whatever writes ONNX begins with it."""

_STANDARD_DOMAINS = (b"", b"ai.onnx")
_DEFAULT_LOCATION = 0

Check = Callable[["_Walk", int, int, memoryview], None]
Allowed = dict[int, Check | None]
"""By field number; None: allowed, and nothing in it could do harm."""


def check_structure(data: bytes) -> OnnxFile:
    """Check a whole ONNX file; what it is made of.

    Raises:
        ContractError: it is not an ONNX model, made of something that is not allowed, or the size
            of some tensor may depend on the picture.

    """
    _walk(data, _raise)
    model = read_onnx(data)
    _check_static_shapes(model)
    return model


def structure_faults(data: bytes) -> list[str]:
    """Everything that `check_structure` would refuse, each once."""
    found: list[str] = []
    try:
        _walk(data, found.append)
        if not found:  # what follows would stumble over the same parts
            _check_static_shapes(read_onnx(data))
    except ContractError as error:  # damage: nothing can be read behind it
        found.append(str(error))
    return list(dict.fromkeys(found))


def _check_static_shapes(model: OnnxFile) -> None:
    """Raises ContractError where the size of a tensor may depend on the picture."""
    known, made = set(model.weights), set(INPUT_NAMES)
    if known & made:
        raise ContractError(f"the model has weights of the name {min(known & made)!r}")
    made |= known
    for node in model.nodes:
        outputs = set(node.outputs) - {""}
        if twice := outputs & made:
            raise ContractError(f"the model makes {min(twice)[:80]!r} twice")
        made |= outputs
        for index in SHAPING.get(node.operator, ()):
            if index < len(node.inputs) and node.inputs[index] not in known | {""}:
                raise ContractError(
                    f"the size of what {node.operator} makes ({', '.join(sorted(outputs))[:80]}) "
                    "may depend on the picture: export a network in which none does"
                )
        if node.operator == "Shape" or known.issuperset(filter(None, node.inputs)):
            known |= outputs


def _walk(data: bytes, refuse: Callable[[str], None]) -> None:
    if not data:
        raise ContractError("the file is empty; was the export interrupted?")
    if not data.startswith(_FIRST_BYTE):
        raise ContractError("this is not an ONNX model; export the policy to ONNX first")
    _Walk(refuse).message(memoryview(data), _MODEL, "the model")


def _raise(fault: str) -> None:
    raise ContractError(fault)


class _Walk:
    """One walk through a file: counts what it has visited, and hands on what is not allowed."""

    def __init__(self, refuse: Callable[[str], None]) -> None:
        self._visited = 0
        self.refuse = refuse

    def message(self, data: memoryview, allowed: Allowed, what: str) -> None:
        for number, wire_type, value, content in fields(data):
            self._visited += 1
            if self._visited > MOST_FIELDS:
                raise ContractError(f"the model has more than {MOST_FIELDS} parts, far too many")
            if number not in allowed:
                words = _FORBIDDEN.get((what, number), f"field {number}, which no policy needs")
                self.refuse(f"{what} has {words}: export a plain network")
            elif (check := allowed[number]) is not None:
                check(self, wire_type, value, content)


def _inside(allowed: Callable[[], Allowed], what: str) -> Check:
    def check(walk: _Walk, wire_type: int, _: int, content: memoryview) -> None:
        if wire_type != LENGTH:
            raise ContractError("the ONNX data is truncated or damaged")
        walk.message(content, allowed(), what)

    return check


def _operator(walk: _Walk, _: int, __: int, content: memoryview) -> None:
    name = content.tobytes()[:80].decode(errors="replace")
    if name not in OPERATORS:
        walk.refuse(
            f"the model uses the operator {name!r}, which a robot does not run; "
            "mbot_protocol/policy/model_structure.py lists those it does"
        )


def _domain(walk: _Walk, _: int, __: int, content: memoryview) -> None:
    if content.tobytes() not in _STANDARD_DOMAINS:
        name = content.tobytes()[:80].decode(errors="replace")
        walk.refuse(f"the model uses operators of {name!r}, expected ONNX's own")


def _location(walk: _Walk, _: int, value: int, __: memoryview) -> None:
    if value != _DEFAULT_LOCATION:
        walk.refuse("the model's weights are in another file: export with external_data=False")


def _node(walk: _Walk, wire_type: int, value: int, content: memoryview) -> None:
    _inside(lambda: _NODE, "a node")(walk, wire_type, value, content)
    if all(number != _OPERATOR for number, *_ in fields(content)):
        walk.refuse("a node of the model has no operator: export it again")


def _tensor(walk: _Walk, wire_type: int, value: int, content: memoryview) -> None:
    """A tensor has at least a byte for each element, so more elements than bytes is a lie."""
    _inside(lambda: _TENSOR, "a tensor")(walk, wire_type, value, content)
    elements = 1
    for number, kind, size, packed in fields(content):
        if number == _DIMENSIONS:
            for one in (size,) if kind == VARINT else varints(packed):
                elements *= max(1, one)  # a negative one is a huge one here
    if elements > LARGEST_MODEL_BYTES:
        walk.refuse(f"a tensor of the model has more than {LARGEST_MODEL_BYTES} elements")


def _plain(*numbers: int) -> Allowed:
    return dict.fromkeys(numbers)


# The numbers are those of onnx.proto3 (ONNX 1.18); a test compares the names.
_DIMENSIONS = 1
_OPERATOR = 4
_TENSOR = _plain(_DIMENSIONS, 2, 4, 5, 7, 8, 9, 10, 11, 12, 16) | {14: _location}
_ATTRIBUTE = _plain(1, 2, 3, 4, 7, 8, 9, 13, 20) | {5: _tensor}
_NODE = _plain(1, 2, 3, 6, 9) | {
    _OPERATOR: _operator,
    5: _inside(lambda: _ATTRIBUTE, "an attribute"),
    7: _domain,
}
_GRAPH = _plain(2, 10, 11, 12, 13, 16) | {
    1: _node,
    5: _tensor,
}
_MODEL = _plain(1, 2, 3, 4, 5, 6, 8, 14) | {7: _inside(lambda: _GRAPH, "the graph")}

_FORBIDDEN = {
    ("the model", 20): "training steps inside",
    ("the model", 25): "functions of its own",
    ("the graph", 15): "sparse weights",
    ("an attribute", 6): "a graph inside",
    ("an attribute", 10): "a list of tensors",
    ("an attribute", 11): "graphs inside",
    ("an attribute", 22): "sparse weights",
    ("a tensor", 6): "texts as weights",
    ("a tensor", 13): "its data in another file (export with external_data=False)",
}
