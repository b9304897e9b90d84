"""Whose models this robot takes: everything about a push that is decided before its bytes are."""

import logging
import secrets
import threading
import time
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from mbot_agent import configuration
from mbot_agent.faults import Notice
from mbot_agent.models.model_directory import Label
from mbot_agent.models.sequence_floors import SequenceFloors
from mbot_protocol.errors import RefusedError
from mbot_protocol.signing.envelope import MODEL, Envelope, Signature, verify
from mbot_protocol.signing.model_manifest import (
    ACTION_MAP,
    INPUT,
    NONCE_BYTES,
    OUTPUT,
    ModelManifest,
    decode,
)
from mbot_protocol.signing.public_key import PublicKey
from mbot_protocol.v1.messages_pb2 import PushBegin

log = logging.getLogger(__name__)

CLOCK_IS_SET = Path("/run/systemd/timesync/synchronized")
"""systemd-timesyncd makes this file once a time server has set the clock (Raspberry Pi OS's
default). Asking the kernel (adjtimex) would need a system call that the unit forbids."""


LIFETIME_S = 60.0

MOST_OUTSTANDING = 64
"""The oldest is forgotten: asking again and again costs no memory. Who can ask so fast as to make
another's number useless can also keep the link busy."""


class Nonces:
    """Numbers used once, those handed out and not used yet. Any thread may use it.

    Each lets one signed push in, within a minute, and none after a restart. They make a recorded
    push worthless without a clock that could be trusted: what a robot without a battery knows of
    the time comes from the network, and so from an attacker.
    """

    def __init__(self) -> None:
        self._issued_s: dict[str, float] = {}  # in the order of issue
        self._lock = threading.Lock()

    def issue(self) -> str:
        """A new number, in hexadecimal."""
        nonce = secrets.token_hex(NONCE_BYTES)
        with self._lock:
            while len(self._issued_s) >= MOST_OUTSTANDING:
                del self._issued_s[next(iter(self._issued_s))]
            self._issued_s[nonce] = time.monotonic()
        return nonce

    def use(self, nonce: str) -> bool:
        """Whether the number was handed out, is young enough and unused; now it is used."""
        with self._lock:
            issued_s = self._issued_s.pop(nonce, None)
        return issued_s is not None and time.monotonic() - issued_s <= LIFETIME_S


@dataclass(frozen=True, slots=True)
class Admission:
    """A push that may go on.

    Attributes:
        signed: its manifest, to be kept with the model; None if it is unsigned.
        sequence: the manifest's.
        signer: the name of the key; empty if unsigned.

    """

    signed: Envelope | None = None
    sequence: int = 0
    signer: str = ""


class Trust:
    """The robot's keys, the nonces it has handed out, and the sequences it has accepted.

    Attributes:
        keys: whose signatures count.
        accepts_unsigned: models without a signature are taken too.

    """

    def __init__(
        self, settings: configuration.Trust, robot_id: str, floors: SequenceFloors
    ) -> None:
        self.keys: tuple[PublicKey, ...] = settings.public_keys
        self.accepts_unsigned = settings.allow_unsigned
        self._robot_id = robot_id
        self._floors = floors
        self._nonces = Nonces()
        if self.keys:
            # Now, or the reply to the first push would wait for it: 7 to 30 ms on a PC (measured),
            # half a second on a Pi Zero 2 (estimated), of the 2 s that the sender waits.
            import_module("nacl.signing")

    @property
    def notice(self) -> Notice | None:
        """What a person should know of whose models are taken."""
        if self.accepts_unsigned:
            text = (
                "takes models from anyone who reaches it (trust.allow_unsigned = true): for "
                "development only"
            )
            return Notice("unsigned-models", text)
        if not self.keys:
            text = "takes no models: `workstation keys new` makes a key and says how it gets here"
            return Notice("no-trusted-key", text)
        return None

    def new_nonce(self) -> str:
        """For one push that is about to be signed."""
        return self._nonces.issue()

    def admit(self, request: PushBegin) -> Admission:
        """Judge a push by its manifest: sizes, then signature, and only then what it says.

        Raises:
            RefusedError: with the reason. The nonce of a good signature is used up even so.
            NewerSchemaError: the manifest is of a newer kind.

        """
        if not request.manifest and not request.signature:
            if self.accepts_unsigned:
                return Admission()
            raise RefusedError(self._why_signed())
        signature = Signature(request.public_key, request.signature)
        signed = Envelope(request.manifest, (signature,))
        signer = self._verify(signed)
        manifest = decode(signed.data)
        if not self._nonces.use(manifest.nonce):
            raise RefusedError(
                "the manifest's nonce is not one this robot has handed out within the last "
                f"{LIFETIME_S:.0f} s, or was used before: push again"
            )
        self._check_robot(manifest)
        if (manifest.sha256, manifest.size_bytes) != (request.sha256, request.size_bytes):
            raise RefusedError("the manifest is another model's: push again")
        _check_contract(manifest)
        _check_expiry(manifest)
        self._check_sequence(manifest, signer)
        return Admission(signed, manifest.sequence, signer.name)

    def note(self, admission: Admission) -> None:
        """The push is about to become active: from now on older ones of its key are refused.

        Raises:
            RefusedError: the disk refuses.

        """
        if admission.signed is not None:
            self._floors.reach(admission.signed.signatures[0].public_key, admission.sequence)

    def signer_of(self, sha256: str, label: Label) -> str:
        """Who has signed a stored model; empty where unsigned ones are taken and this is one.

        Raises:
            RefusedError: none of the keys trusted today has, or it was for another robot, whose SD
                card this one is a copy of.
            NewerSchemaError: its manifest is of a newer kind.

        """
        try:
            signed = label.manifest
            if signed is None:
                raise RefusedError("the model was pushed without a signature: push it again")
            key = self._verify(signed)
            manifest = decode(signed.data)
            if manifest.sha256 != sha256:
                raise RefusedError("the manifest kept with the model is another's: push it again")
        except RefusedError:
            if self.accepts_unsigned:
                return ""
            raise
        self._check_robot(manifest)  # as in a push, whoever else's models are taken
        return key.name

    def _verify(self, signed: Envelope) -> PublicKey:
        if not self.keys:
            raise RefusedError(self._why_signed())
        return verify(MODEL, signed, self.keys)

    def _why_signed(self) -> str:
        if self.keys:
            names = ", ".join(key.name for key in self.keys)
            return (
                f"the model is not signed, and this robot takes only models signed by {names}: "
                "`workstation keys new` makes a key, `workstation push-model` then signs"
            )
        return (
            "this robot trusts no signing key yet: `workstation keys new` makes one and says how "
            "it gets here"
        )

    def _check_robot(self, manifest: ModelManifest) -> None:
        if manifest.robot_id != self._robot_id:
            raise RefusedError(
                f"the model is signed for robot {manifest.robot_id[:80]!r}, this one is "
                f"{self._robot_id!r}: push it to this one"
            )

    def _check_sequence(self, manifest: ModelManifest, signer: PublicKey) -> None:
        floor = self._floors.of(signer.raw)
        if manifest.sequence > floor:
            return
        if not manifest.allow_downgrade:
            raise RefusedError(
                f"the model's sequence {manifest.sequence} is not above {floor}, the last one "
                f"taken from {signer.name}: an older push, or was a workstation's clock ahead? "
                "`workstation push-model --allow-downgrade` signs an exception"
            )
        log.warning("sequence %d below %d: a signed downgrade", manifest.sequence, floor)


def _check_contract(manifest: ModelManifest) -> None:
    """What the model takes and gives must be what this robot would make of it."""
    for what, found, expected in (
        ("input", manifest.input, INPUT),
        ("output", manifest.output, OUTPUT),
    ):
        if found != expected:
            raise RefusedError(
                f"the model's {what} is {found.name[:80]!r} {found.type[:80]} {list(found.shape)}, "
                f"expected {expected.name!r} {expected.type} {list(expected.shape)}"
            )
    if manifest.actions != ACTION_MAP:
        raise RefusedError(
            f"the model's actions mean {manifest.actions[:80]!r}, expected {ACTION_MAP!r}"
        )


def _check_expiry(manifest: ModelManifest) -> None:
    """Only where the clock is known to be right; the nonce has made sure of a minute already."""
    limit_s = manifest.not_after_unix_s
    if limit_s and CLOCK_IS_SET.exists() and time.time() > limit_s:
        raise RefusedError(
            f"the manifest expired {time.time() - limit_s:.0f} s ago: are the workstation's clock "
            "and the robot's right?"
        )
