"""The policy contract: what a model takes, gives and says of itself.

A policy is an ONNX model with one input and one output:

- `observation`: uint8, shape (1, 64, 64, 3), RGB, row 0 at the top;
- `action`: float32, shape (1, 2): left and right wheel in [-1, 1], 1 is full speed forward.

Its metadata says how it wants to be used; `PolicyMetadata` is that, typed.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from mbot_protocol.errors import ContractError, NewerSchemaError

CONTRACT_VERSION = 1
OBSERVATION_SIDE_PX = 64
OBSERVATION_SHAPE = (1, OBSERVATION_SIDE_PX, OBSERVATION_SIDE_PX, 3)
ACTION_SHAPE = (1, 2)
INPUT_NAME, INPUT_TYPE = "observation", "uint8"
OUTPUT_NAME, OUTPUT_TYPE = "action", "float32"
DECISION_RATE_HZ = 2.5
"""The paper's decision rate; `control.decision_rate_hz` of a robot may differ."""

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


@dataclass(frozen=True, slots=True)
class PolicyMetadata:
    """What a model says of itself in its ONNX metadata."""

    name: str
    view: FieldOfView = FULL_VIEW
    decision_rate_hz: float = DECISION_RATE_HZ

    def to_properties(self) -> dict[str, str]:
        """The ONNX metadata properties; `from_properties` reads them back."""
        return {
            "mbot.contract_version": str(CONTRACT_VERSION),
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
        return cls(properties.get("mbot.name", "unnamed"), view, rate_hz)


def _number(properties: Mapping[str, str], key: str) -> float:
    text = properties.get(key)
    if text is None:
        raise ContractError(
            f"the model's metadata has no {key}: export it with `workstation`, or add the property"
        )
    try:
        return float(text)
    except ValueError:
        raise ContractError(f"the model's {key} is {text!r}, expected a number") from None


def check_tensor(
    role: str, name: str, kind: str, shape: tuple[object, ...], *, is_input: bool
) -> None:
    """Check one tensor of a model against the contract.

    Args:
        role: the word for the error text, "input" or "output".
        name, kind, shape: as the model declares them; a symbolic dimension may stand for the
            batch, which is 1.
        is_input: which of the contract's two tensors to compare with.

    Raises:
        ContractError: with what was found and expected.

    """
    expected = (
        (INPUT_NAME, INPUT_TYPE, OBSERVATION_SHAPE)
        if is_input
        else (OUTPUT_NAME, OUTPUT_TYPE, ACTION_SHAPE)
    )
    batch_free = (1, *shape[1:]) if shape and not isinstance(shape[0], int) else shape
    if (name, kind, batch_free) != expected:
        raise ContractError(
            f"the model's {role} is {name!r} {kind} {list(shape)}, expected {expected[0]!r} "
            f"{expected[1]} {list(expected[2])}"
        )
