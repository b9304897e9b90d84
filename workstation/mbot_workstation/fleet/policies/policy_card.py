"""What is told of a published policy, and the signature under it.

Like a robot's manifests it is JSON in one form only; what is signed are the very bytes.
"""

import hashlib
from typing import Annotated, Any

import msgspec
from msgspec import Meta, Struct

from mbot_protocol.errors import NewerSchemaError, RefusedError
from mbot_protocol.policy.policy_contract import LARGEST_MODEL_BYTES
from mbot_protocol.signing.envelope import (
    LARGEST_SIGNATURES_BYTES,
    Envelope,
    Purpose,
    verify,
)
from mbot_protocol.signing.public_key import PublicKey
from mbot_workstation.fleet.models.signing_key import SigningKey
from mbot_workstation.wording import one_line

CARD_VERSION = 1
POLICY = Purpose("policy", b"mbot-agent policy card\0", 64 * 1024, "publishers")
LARGEST_SIGNATURE_BYTES = LARGEST_SIGNATURES_BYTES

NAME_PATTERN = "^[a-z0-9][a-z0-9_-]{0,47}$"
"""Also of its folder: no dots and no slashes, so that it leads nowhere else."""

PolicyName = Annotated[str, Meta(pattern=NAME_PATTERN)]
Digest = Annotated[str, Meta(pattern="^[0-9a-f]{64}$")]
Words = Annotated[str, Meta(max_length=1000)]


class RewardInterval(Struct, frozen=True, forbid_unknown_fields=True):
    """A mean with its 95 % interval."""

    mean: float
    low: float
    high: float

    @property
    def words(self) -> str:
        """For people."""
        return f"{self.mean:.2f} ({self.low:.2f} to {self.high:.2f})"


class Tried(Struct, frozen=True, forbid_unknown_fields=True):
    """Reward an episode on one kind of robots, simulated, beside the colour servo's there."""

    preset: str
    lesson: str
    episodes: int
    seed: int
    reward: RewardInterval
    servo: RewardInterval


class PolicyCard(Struct, frozen=True, forbid_unknown_fields=True):
    """What a publisher vouches for.

    Attributes:
        name: of the policy, and of its folder.
        publisher: what the key's owner is called; the key is what counts.
        sha256, size_bytes: of the model file.
        task, object: what it is for, in words.
        training: what the model's file says of it; empty where it says nothing.
        evaluation: made when it was published.
        not_good_at: as the publisher knows.
        based_on: the digest of the policy it was trained on from; empty: none.
        published_unix_s: by the publisher's clock.

    """

    name: PolicyName
    publisher: Words
    sha256: Digest
    size_bytes: Annotated[int, Meta(ge=1, le=LARGEST_MODEL_BYTES)]
    task: Words
    object: Words
    training: dict[str, Any]
    evaluation: tuple[Tried, ...]
    not_good_at: tuple[Words, ...]
    based_on: Words
    published_unix_s: int
    version: int = CARD_VERSION

    def lines(self) -> list[str]:
        """For people, safe to print."""
        found = [
            f"{self.name} {self.sha256[:12]}, by {self.publisher}: task {self.task}, for the "
            f"{self.object}"
        ]
        found += [
            f"  {one.preset}, lesson {one.lesson}, {one.episodes} episodes: {one.reward.words}; "
            f"the colour servo {one.servo.words}"
            for one in self.evaluation
        ]
        found += [f"  not good at: {words}" for words in self.not_good_at]
        if self.based_on:
            found.append(f"  based on {self.based_on}")
        if self.training:
            run = [f"{k} {v}" for k, v in self.training.items() if isinstance(v, str | int | float)]
            found.append(f"  training: {', '.join(run)}")
        return ["  " * line.startswith("  ") + one_line(line) for line in found]


class SignedCard(Struct, frozen=True):
    """A card whose signature is good, and whose key that was: not yet, that the key is trusted."""

    card: PolicyCard
    key: PublicKey


def fingerprint(key: PublicKey) -> str:
    """Of a key, for people to compare: 128 bits of its SHA-256."""
    digits = hashlib.sha256(key.raw).hexdigest()[:32]
    return "-".join(digits[at : at + 4] for at in range(0, 32, 4))


def encode_card(card: PolicyCard) -> bytes:
    """The one form of this card in bytes."""
    return msgspec.json.format(msgspec.json.encode(card), indent=1) + b"\n"


def sign_card(card: PolicyCard, key: SigningKey) -> tuple[bytes, bytes]:
    """The card's file and the signature's."""
    data = encode_card(card)
    return data, key.sign(POLICY, data).line.encode()


def read_card(data: bytes, signature: bytes, name: str) -> SignedCard:
    """A card, its signature checked before anything of it is read.

    Raises:
        RefusedError: the signature is missing, damaged or another card's, or the card is none.
        NewerSchemaError: it is of a newer kind.

    """
    try:
        envelope = Envelope.with_lines(data, signature)
        (one,) = envelope.signatures
    except (RefusedError, ValueError):
        raise RefusedError(f"{name}: its signature is damaged, or it has none") from None
    claimed = PublicKey(one.public_key, name)
    try:
        verify(POLICY, envelope, [claimed])
    except RefusedError:
        raise RefusedError(f"{name}: the card is not what was signed") from None
    try:
        found = msgspec.json.decode(data, type=dict[str, Any])
        if isinstance(version := found.get("version"), int) and version > CARD_VERSION:
            raise NewerSchemaError(f"{name}: its card is of a newer version: upgrade mbot-agent")
        card = msgspec.json.decode(data, type=PolicyCard)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise RefusedError(f"{name}: its card is unusable: {one_line(str(error))}") from None
    if encode_card(card) != data or card.name != name:
        raise RefusedError(f"{name}: its card is another policy's, or not in its one form")
    return SignedCard(card, PublicKey(one.public_key, "publisher"))
