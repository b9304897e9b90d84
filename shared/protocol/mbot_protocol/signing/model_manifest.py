"""The signed manifest of a pushed model: what it is, for which robot, and for this one push.

What is signed are the very bytes that travel. They are JSON that has one form only: `decode`
refuses bytes which `encode` would not have written, so two readers can't see two manifests.
"""

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

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
from mbot_protocol.signing.public_key import SIGNATURE_BYTES, PublicKey

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

MANIFEST_VERSION = 1
LARGEST_MANIFEST_BYTES = 2048
"""Ours have about 410."""

NONCE_BYTES = 16

ACTION_MAP = f"left,right in -1..1 to -{STEP_LIMIT}..{STEP_LIMIT} motor steps"
"""What the model's two numbers mean; a robot that would read them otherwise refuses the model."""

_DOMAIN = b"mbot-agent model manifest\0"
"""Signed in front of the manifest: the key's signature under anything else is none under this."""

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


@dataclass(frozen=True, slots=True)
class SignedManifest:
    """A manifest as it travels and as it is kept beside the model.

    Attributes:
        manifest: the bytes that are signed.
        signature: Ed25519 (RFC 8032), 64 bytes.
        public_key: whose signature it is meant to be, 32 bytes.

    """

    manifest: bytes
    signature: bytes
    public_key: bytes

    def to_text(self) -> str:
        """One line of text for a file; `from_text` reads it."""
        return " ".join(
            base64.b64encode(part).decode()
            for part in (self.manifest, self.signature, self.public_key)
        )

    @classmethod
    def from_text(cls, text: str) -> "SignedManifest":
        """Read what `to_text` wrote.

        Raises:
            RefusedError: the text is damaged.

        """
        try:
            manifest, signature, public_key = (
                base64.b64decode(part, validate=True) for part in text.split(" ")
            )
        except ValueError:
            raise RefusedError("the manifest kept with the model is damaged") from None
        return cls(manifest, signature, public_key)


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


def sign(manifest: ModelManifest, key: "Ed25519PrivateKey") -> SignedManifest:
    """The manifest with its signature."""
    from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat

    data = encode(manifest)
    public_key = key.public_key().public_bytes(Encoding.Raw, PublicFormat.Raw)
    return SignedManifest(data, key.sign(_DOMAIN + data), public_key)


def verify(signed: SignedManifest, trusted: Sequence[PublicKey]) -> PublicKey:
    """Which of the trusted keys has signed. Nothing of the manifest is read.

    Raises:
        RefusedError: a part has the wrong size, no trusted key is named, or the signature is
            not that key's.

    """
    parts: tuple[tuple[str, Any, int, int], ...] = (
        ("manifest", signed.manifest, 1, LARGEST_MANIFEST_BYTES),
        ("signature", signed.signature, SIGNATURE_BYTES, SIGNATURE_BYTES),
    )
    for what, part, least, most in parts:
        if not least <= len(part) <= most:
            expected = f"{most}" if least == most else f"{least} to {most}"
            raise RefusedError(f"the {what} has {len(part)} bytes, expected {expected}")
    key = next((key for key in trusted if key.raw == signed.public_key), None)
    if key is None:
        shown = base64.b64encode(signed.public_key[:64]).decode()
        raise RefusedError(
            f"the model is signed by ed25519:{shown}, which is not among this robot's [trust] keys"
        )
    if not key.has_signed(_DOMAIN + signed.manifest, signed.signature):
        raise RefusedError(
            f"the signature is not {key.name}'s: the manifest was changed, or the key is another"
        )
    return key
