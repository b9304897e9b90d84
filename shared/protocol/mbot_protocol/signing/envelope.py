"""What is signed, for models and releases alike: bytes, and the signatures of some keys under them.

What is signed are the very bytes that travel, so two readers can't see two manifests. In front of
them goes what they are for: a key's signature under a model is none under a release.
Standard library only: the robot's updater reads it without anything of the daemon's.
"""

import base64
import binascii
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from mbot_protocol.errors import RefusedError
from mbot_protocol.signing.public_key import PUBLIC_KEY_BYTES, SIGNATURE_BYTES, PublicKey

LARGEST_SIGNATURES_BYTES = 1024

_KIND = "ed25519:"

HasSigned = Callable[[PublicKey, bytes, bytes], bool]
"""Whether a key's signature is good: key, message, signature."""


@dataclass(frozen=True, slots=True)
class Purpose:
    """What a signature is for.

    Attributes:
        noun: what it vouches for.
        domain: signed in front of the bytes; none begins with another's.
        largest_bytes: what is signed may have no more.
        key_list: in [trust] of the robot's configuration, whose signatures count.

    """

    noun: str
    domain: bytes
    largest_bytes: int
    key_list: str


MODEL = Purpose("model", b"mbot-agent model manifest\0", 2048, "keys")
"""Ours have about 410 bytes."""

RELEASE = Purpose("release", b"mbot-agent release manifest\0", 48 * 1024, "release_keys")
"""Ours have about 8,000 bytes; they travel in one message."""


@dataclass(frozen=True, slots=True)
class Signature:
    """One key's.

    Attributes:
        public_key: whose it is meant to be, 32 bytes.
        signature: Ed25519 (RFC 8032), 64 bytes.

    """

    public_key: bytes
    signature: bytes

    @property
    def line(self) -> str:
        """For a file of signatures."""
        return f"{_KIND}{_base64(self.public_key)} {_base64(self.signature)}\n"


@dataclass(frozen=True, slots=True)
class Envelope:
    """Bytes with the signatures under them, of which one by a trusted key is enough."""

    data: bytes
    signatures: tuple[Signature, ...]

    @classmethod
    def with_lines(cls, data: bytes, lines: bytes) -> "Envelope":
        """Bytes with a file of signatures.

        Raises:
            RefusedError: the file is too large or damaged.

        """
        try:
            if len(lines) > LARGEST_SIGNATURES_BYTES:
                raise ValueError
            found = tuple(map(_from_line, lines.decode("ascii").splitlines()))
        except (ValueError, binascii.Error):
            raise RefusedError("the release's signatures are damaged") from None
        return cls(data, found)

    @classmethod
    def from_text(cls, text: str) -> "Envelope":
        """Read what `to_text` wrote.

        Raises:
            RefusedError: the text is damaged.

        """
        try:
            data, signature, public_key = (
                base64.b64decode(part, validate=True) for part in text.split(" ")
            )
        except ValueError:
            raise RefusedError("the manifest kept with the model is damaged") from None
        return cls(data, (Signature(public_key, signature),))

    def to_text(self) -> str:
        """One line, for bytes with one signature."""
        (one,) = self.signatures
        return " ".join(map(_base64, (self.data, one.signature, one.public_key)))


def sign(
    purpose: Purpose, data: bytes, sign_bytes: Callable[[bytes], bytes], public_key: bytes
) -> Signature:
    """A key's signature under these bytes for this purpose alone."""
    return Signature(public_key, sign_bytes(purpose.domain + data))


def verify(
    purpose: Purpose,
    envelope: Envelope,
    trusted: Sequence[PublicKey],
    has_signed: HasSigned = PublicKey.has_signed,
) -> PublicKey:
    """Which of the trusted keys has signed. Nothing of the bytes is read.

    Raises:
        RefusedError: a part has the wrong size, no trusted key is named, or the signature is
            not that key's.

    """
    data, noun = envelope.data, purpose.noun
    if not 0 < len(data) <= purpose.largest_bytes:
        raise RefusedError(
            f"the manifest has {len(data)} bytes, expected 1 to {purpose.largest_bytes}"
        )
    for one in envelope.signatures:
        if len(one.signature) != SIGNATURE_BYTES:
            raise RefusedError(
                f"the signature has {len(one.signature)} bytes, expected {SIGNATURE_BYTES}"
            )
    if not trusted:
        raise RefusedError(
            f"this robot trusts no key for {noun}s: put the line that `workstation keys show` "
            f"prints, in quotes, into the list {purpose.key_list} in [trust] of "
            "/etc/mbot-agent/config.toml and restart mbot-agent"
        )
    for one in envelope.signatures:
        key = next((key for key in trusted if key.raw == one.public_key), None)
        if key is None:
            continue
        if not has_signed(key, purpose.domain + data, one.signature):
            raise RefusedError(
                f"the signature is not {key.name}'s: the manifest was changed, or the key is "
                "another"
            )
        return key
    shown = ", ".join(f"{_KIND}{_base64(one.public_key[:64])}" for one in envelope.signatures)
    raise RefusedError(
        f"the {noun} is signed by {shown or 'nobody'}, which is not among this robot's "
        f"[trust] {purpose.key_list}"
    )


def _from_line(line: str) -> Signature:
    """Raises ValueError or binascii.Error if it is none."""
    key, signature = line.removeprefix(_KIND).split(" ")
    found = Signature(
        base64.b64decode(key, validate=True), base64.b64decode(signature, validate=True)
    )
    if (len(found.public_key), len(found.signature)) != (PUBLIC_KEY_BYTES, SIGNATURE_BYTES):
        raise ValueError
    return found


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode()
