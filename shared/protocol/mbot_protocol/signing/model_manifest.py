"""The signed manifest of a pushed model: what it is, for which robot, and for this one push.

It is JSON that has one form only: `decode` refuses bytes which `encode` would not have written, so
two readers can't see two manifests. `envelope.py` has the signature.
"""

from typing import Annotated

import msgspec
from msgspec import Meta, Struct

from mbot_protocol.drive.actions import STEP_LIMIT
from mbot_protocol.errors import NewerSchemaError, RefusedError
from mbot_protocol.policy.policy_contract import (
    ACTION_SHAPE,
    INPUT_NAME,
    INPUT_TYPE,
    LARGEST_MODEL_BYTES,
    OBSERVATION_SHAPE,
    OUTPUT_NAME,
    OUTPUT_TYPE,
)

MANIFEST_VERSION = 1
NONCE_BYTES = 16

ACTION_MAP = f"left,right in -1..1 to -{STEP_LIMIT}..{STEP_LIMIT} motor steps"
"""What the model's two numbers mean; a robot that would read them otherwise refuses the model."""

Positive = Annotated[int, Meta(ge=1, le=2**63 - 1)]


class Tensor(Struct, frozen=True, forbid_unknown_fields=True):
    """Name, numpy type and shape of a model's input or output."""

    name: str
    type: str
    shape: tuple[int, ...]


INPUT = Tensor(INPUT_NAME, INPUT_TYPE, OBSERVATION_SHAPE)
OUTPUT = Tensor(OUTPUT_NAME, OUTPUT_TYPE, ACTION_SHAPE)


class ModelManifest(Struct, frozen=True, forbid_unknown_fields=True):
    """What a signature vouches for.

    Attributes:
        robot_id: the one robot the model is for.
        sequence: grows with every push of this key; the robot takes no smaller or equal one.
        sha256, size_bytes: of the model file.
        input, output: its tensors.
        actions: how its answer becomes motor steps, `ACTION_MAP`.
        nonce: the robot's, in hexadecimal: good for one push within a minute.
        not_after_unix_s: refused after that by a robot whose clock is set; 0: no such limit.
        allow_downgrade: take it in spite of its sequence.

    """

    robot_id: str
    sequence: Positive
    sha256: Annotated[str, Meta(pattern="^[0-9a-f]{64}$")]
    size_bytes: Annotated[int, Meta(ge=1, le=LARGEST_MODEL_BYTES)]
    nonce: Annotated[str, Meta(pattern=f"^[0-9a-f]{{{2 * NONCE_BYTES}}}$")]
    not_after_unix_s: Annotated[int, Meta(ge=0, le=2**63 - 1)] = 0
    allow_downgrade: bool = False
    input: Tensor = INPUT
    output: Tensor = OUTPUT
    actions: str = ACTION_MAP
    version: int = MANIFEST_VERSION


class _Version(Struct):
    version: int


def encode(manifest: ModelManifest) -> bytes:
    """The one form of this manifest in bytes."""
    return msgspec.json.encode(manifest)


def decode(data: bytes) -> ModelManifest:
    """Read a manifest. Only bytes whose signature is known to be good belong here.

    Raises:
        NewerSchemaError: it is of a newer kind.
        RefusedError: it is not a manifest, out of range, or not in its one form.

    """
    try:
        version = msgspec.json.decode(data, type=_Version).version
        if version > MANIFEST_VERSION:
            raise NewerSchemaError(
                f"the manifest has version {version}, this software knows up to "
                f"{MANIFEST_VERSION}: upgrade mbot-agent"
            )
        manifest = msgspec.json.decode(data, type=ModelManifest)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise RefusedError(f"the manifest is unusable: {error}") from None
    if encode(manifest) != data:
        raise RefusedError("the manifest is unusable: it is not in its one canonical form")
    return manifest
