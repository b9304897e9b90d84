"""The policy contract: what a model takes, gives and says of itself.

A policy is an ONNX model. Version 1 has one input and one output:

- `observation`: uint8, shape (1, 64, 64, 3), RGB, row 0 at the top;
- `action`: float32, shape (1, 2): left and right wheel in [-1, 1], 1 is full speed forward.

Version 2 has a memory besides. Whoever runs it hands back what it said in the decision before, and
zeros at first, after every break, and whenever it is not sure:

- inputs `previous_action`: float32, shape (1, 2), what the wheels were really told, and `state_in`:
  float32, shape (layers, 1, units);
- output `state_out`, of the same shape.

Its metadata says how it wants to be used; `PolicyMetadata` is that, typed.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mbot_protocol.errors import ContractError, NewerSchemaError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

CONTRACT_VERSION = 2
OBSERVATION_SIDE_PX = 64
OBSERVATION_SHAPE = (1, OBSERVATION_SIDE_PX, OBSERVATION_SIDE_PX, 3)
ACTION_SHAPE = (1, 2)
INPUT_NAME, INPUT_TYPE = "observation", "uint8"
OUTPUT_NAME, OUTPUT_TYPE = "action", "float32"
PREVIOUS_ACTION_NAME = "previous_action"
STATE_IN_NAME, STATE_OUT_NAME = "state_in", "state_out"
INPUT_NAMES = frozenset((INPUT_NAME, PREVIOUS_ACTION_NAME, STATE_IN_NAME))
LARGEST_STATE = 65_536
"""Numbers of a memory; a tenth of the paper's weights."""
DECISION_RATE_HZ = 2.5
"""The paper's decision rate; `control.decision_rate_hz` of a robot may differ."""

SAFE_IR_VERSION, SAFE_OPSET = 10, 21
"""Every robot's onnxruntime reads these; onnx writes newer ones by default."""

LARGEST_MODEL_BYTES = 16 * 2**20
"""The paper's network has 0.6 million weights, 2.4 MB; anything far larger is a mistake."""


@dataclass(frozen=True, slots=True)
class FieldOfView:
    """The rays an observation covers, symmetric about the optical axis, in degrees."""

    horizontal_deg: float
    vertical_deg: float

    def __post_init__(self) -> None:
        for name, angle in (("horizontal", self.horizontal_deg), ("vertical", self.vertical_deg)):
            if not (math.isfinite(angle) and 1.0 <= angle <= 170.0):
                raise ValueError(f"{name} field of view is {angle} degrees, expected 1 to 170")


FULL_VIEW = FieldOfView(55.3, 42.9)
"""All the Pi camera sees, pixels not square: 29 % wider than a square crop, which is what finds
objects in a search turn."""


MISSING_PROPERTY = "missing-property"
"""The kind of a ContractError about metadata that a model does not have at all."""


@dataclass(frozen=True, slots=True)
class PolicyMetadata:
    """What a model says of itself in its ONNX metadata."""

    name: str
    view: FieldOfView = FULL_VIEW
    decision_rate_hz: float = DECISION_RATE_HZ
    contract_version: int = 1

    def to_properties(self) -> dict[str, str]:
        """The ONNX metadata properties; `from_properties` reads them back."""
        return {
            "mbot.contract_version": str(self.contract_version),
            "mbot.name": self.name,
            "mbot.horizontal_fov_deg": repr(self.view.horizontal_deg),
            "mbot.vertical_fov_deg": repr(self.view.vertical_deg),
            "mbot.decision_rate_hz": repr(self.decision_rate_hz),
        }

    @classmethod
    def from_properties(cls, properties: Mapping[str, str]) -> "PolicyMetadata":
        """Read a model's metadata properties.

        Raises:
            NewerSchemaError: the model follows a newer contract than this software.
            ContractError: a property is missing or out of range.

        """
        version = _number(properties, "mbot.contract_version")
        if version > CONTRACT_VERSION:
            raise NewerSchemaError(
                f"the model follows policy contract {version:g}, this software knows up to "
                f"{CONTRACT_VERSION}: upgrade mbot-agent"
            )
        if version not in range(1, CONTRACT_VERSION + 1):
            raise ContractError(
                f"mbot.contract_version is {version:g}, expected 1, or 2 with a memory"
            )
        rate_hz = _number(properties, "mbot.decision_rate_hz")
        if not 0.5 <= rate_hz <= 20.0:
            raise ContractError(f"mbot.decision_rate_hz is {rate_hz:g}, expected 0.5 to 20")
        try:
            view = FieldOfView(
                _number(properties, "mbot.horizontal_fov_deg"),
                _number(properties, "mbot.vertical_fov_deg"),
            )
        except ValueError as error:
            raise ContractError(f"the model's {error}") from None
        return cls(properties.get("mbot.name", "unnamed"), view, rate_hz, int(version))


def _number(properties: Mapping[str, str], key: str) -> float:
    text = properties.get(key)
    if text is None:
        raise ContractError(
            f"the model's metadata has no {key}: export it with `workstation`, or add the property",
            kind=MISSING_PROPERTY,
        )
    try:
        return float(text)
    except ValueError:
        raise ContractError(f"the model's {key} is {text!r}, expected a number") from None


@dataclass(frozen=True, slots=True)
class Tensor:
    """An input or output as a model declares it.

    Attributes:
        name: of it.
        kind: of its elements, as numpy names it.
        shape: with numbers, or names where it is symbolic.

    """

    name: str
    kind: str
    shape: tuple[object, ...]

    def __str__(self) -> str:
        return f"{self.name!r} {self.kind} {list(self.shape)}"


@dataclass(frozen=True, slots=True)
class MemoryShape:
    """Of a model's state, (layers, 1, units); no layers: it has no memory."""

    layers: int = 0
    units: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Memory:
    """What a model goes on with from one decision to the next.

    Attributes:
        state: shape (layers, 1, units), float32; without layers for a model without memory.
        previous_action: what the wheels were really told, left and right in [-1, 1].

    """

    state: "NDArray[np.float32]"
    previous_action: tuple[float, float] = (0.0, 0.0)


def check_signature(
    inputs: Sequence[Tensor], outputs: Sequence[Tensor], version: int
) -> MemoryShape:
    """Compare a model's inputs and outputs with the contract.

    Args:
        inputs, outputs: as the model declares them; a symbolic dimension may stand for the batch,
            which is 1.
        version: of the contract that the model says it follows.

    Returns:
        The memory to keep for it.

    Raises:
        ContractError: with what was found and expected.

    """
    for fault in signature_faults(inputs, outputs, version):
        raise ContractError(fault)
    return MemoryShape() if version == 1 or len(inputs) == 1 else _memory(inputs)


def signature_faults(
    inputs: Sequence[Tensor], outputs: Sequence[Tensor], version: int
) -> Iterator[str]:
    """Everything that is off in a signature, each as found and expected; as `check_signature`."""
    observation = Tensor(INPUT_NAME, INPUT_TYPE, OBSERVATION_SHAPE)
    action = Tensor(OUTPUT_NAME, OUTPUT_TYPE, ACTION_SHAPE)
    if version == 1 or len(inputs) == 1:
        yield from _faults("input", inputs, [observation])
        yield from _faults("output", outputs, [action])
        return
    try:
        memory = _memory(inputs)
    except ContractError as error:
        yield str(error)
        return
    state = (memory.layers, 1, memory.units)
    previous = Tensor(PREVIOUS_ACTION_NAME, OUTPUT_TYPE, ACTION_SHAPE)
    state_in = Tensor(STATE_IN_NAME, OUTPUT_TYPE, state)
    yield from _faults("input", inputs, [observation, previous, state_in])
    yield from _faults("output", outputs, [action, Tensor(STATE_OUT_NAME, OUTPUT_TYPE, state)])


def _memory(inputs: Sequence[Tensor]) -> MemoryShape:
    """The shape of `state_in`."""
    for tensor in inputs:
        if tensor.name == STATE_IN_NAME and len(tensor.shape) == 3:
            layers, _, units = tensor.shape
            if isinstance(layers, int) and isinstance(units, int):
                if min(layers, units) < 1 or layers * units > LARGEST_STATE:
                    raise ContractError(
                        f"the model's {STATE_IN_NAME} has the shape {list(tensor.shape)}, expected "
                        f"1 to {LARGEST_STATE} numbers"
                    )
                return MemoryShape(layers, units)
    return MemoryShape(1, 1)  # which is then missed, or compared with what was found


def _faults(role: str, found: Sequence[Tensor], expected: Sequence[Tensor]) -> Iterator[str]:
    names = ", ".join(tensor.name for tensor in found) or "none"
    if len(found) != len(expected):
        yield (
            f"the model has {len(found)} {role}s ({names}), expected {len(expected)}: "
            + ", ".join(tensor.name for tensor in expected)
        )
        return
    by_name = {tensor.name: tensor for tensor in found}
    for wanted, at_its_place in zip(expected, found, strict=True):
        tensor = by_name.get(wanted.name, at_its_place)
        if Tensor(tensor.name, tensor.kind, _with_batch(tensor.shape, wanted.shape)) != wanted:
            yield f"the model's {role} is {tensor}, expected {wanted}"


def _with_batch(shape: tuple[object, ...], wanted: tuple[object, ...]) -> tuple[object, ...]:
    """The shape with 1 for a symbolic batch: a state's second dimension, else the first."""
    at = 1 if len(wanted) == 3 else 0
    if len(shape) == len(wanted) and not isinstance(shape[at], int):
        return (*shape[:at], 1, *shape[at + 1 :])
    return shape
