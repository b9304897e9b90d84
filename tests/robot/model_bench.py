"""A robot's model service without a network, and somebody who signs and pushes to it."""

import hashlib
import itertools
import time
from dataclasses import dataclass
from pathlib import Path

from mbot_agent.configuration import Configuration, Models, Trust
from mbot_agent.faults import Notice
from mbot_agent.models.model_directory import ModelDirectory
from mbot_agent.models.model_keeper import ModelKeeper
from mbot_agent.models.model_service import ModelService, TryModel
from mbot_agent.models.sequence_floors import SequenceFloors
from mbot_agent.models.trial import Trial
from mbot_agent.models.trust import Trust as TrustChecks
from mbot_protocol.policy.dry_run import Report
from mbot_protocol.policy.policy import Policy
from mbot_protocol.signing.envelope import MODEL
from mbot_protocol.signing.model_manifest import ModelManifest, encode
from mbot_protocol.v1.messages_pb2 import (
    Activate,
    ModelList,
    PushBegin,
    PushChunk,
    PushCommit,
    PushNonce,
    PushNonceReply,
    PushReply,
)
from mbot_protocol.wire.keys import CHUNK_BYTES
from mbot_protocol.wire.schema import SCHEMA_VERSION
from mbot_workstation.fleet.models.signing_key import SigningKey

ROBOT_ID = "mbot-1"
CLEAN_DECISIONS = 5
KEY = SigningKey.ephemeral("anna")
OTHER_KEY = SigningKey.ephemeral("bert")

_sequence = itertools.count(time.time_ns())


def digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def untried(_data: bytes, _rate_hz: float) -> Report:
    """In place of the dry run, where it is not the point: that takes a process each."""
    return Report(0.1, 0)


@dataclass(frozen=True)
class SignedManifest:
    """As it travels."""

    manifest: bytes
    signature: bytes
    public_key: bytes


def sealed(manifest: ModelManifest, key: SigningKey) -> SignedManifest:
    data = encode(manifest)
    signed = key.sign(MODEL, data)
    return SignedManifest(data, signed.signature, signed.public_key)


def sign(data: bytes, nonce: str, key: SigningKey = KEY, **changes: object) -> SignedManifest:
    fields: dict[str, object] = {
        "robot_id": ROBOT_ID,
        "sequence": next(_sequence),
        "sha256": digest(data),
        "size_bytes": len(data),
        "nonce": nonce,
    }
    manifest = ModelManifest(**(fields | changes))  # pyright: ignore[reportArgumentType]
    return sealed(manifest, key)


class Robot:
    """One life of the daemon, as far as models go. `Robot(same directory)` is the next life."""

    def __init__(
        self,
        directory: Path,
        *,
        trust: Trust | None = None,
        keep: int = 4,
        try_model: TryModel = untried,
        robot_id: str = ROBOT_ID,
    ) -> None:
        self.directory = directory
        self.robot_id = robot_id
        self.used: list[tuple[Policy, Trial]] = []
        self.changes: list[str] = []
        settings = Trust((KEY.public.line,)) if trust is None else trust
        configuration = Configuration(
            robot_id=robot_id, models=Models(str(directory), keep=keep), trust=settings
        )
        self.store = ModelDirectory(directory, keep)
        self.floors = SequenceFloors(directory)
        self.trust = TrustChecks(settings, robot_id, self.floors)
        self.keeper = ModelKeeper(
            self.store,
            self.trust,
            CLEAN_DECISIONS,
            lambda policy, trial: self.used.append((policy, trial)),
            self.changes.append,
        )
        self.keeper.load_active()
        self.service = ModelService(configuration, self.store, self.keeper, self.trust, try_model)

    @property
    def notices(self) -> tuple[Notice, ...]:
        return self.keeper.notices

    @property
    def active(self) -> str:
        """The name of the model in use; empty without one."""
        model = self.service.active_model
        return model.name if model is not None else ""

    @property
    def trial(self) -> Trial:
        return self.used[-1][1]

    def nonce(self) -> str:
        request = PushNonce(schema_version=SCHEMA_VERSION, robot_id=self.robot_id)
        reply = PushNonceReply.FromString(self.service.nonce(request.SerializeToString()))
        assert reply.accepted, reply.reason
        return reply.nonce

    def begin(
        self, data: bytes, signed: SignedManifest | None = None, **changes: object
    ) -> PushReply:
        """With a manifest of its own if none is given."""
        if signed is None:
            signed = sign(data, self.nonce(), robot_id=self.robot_id)
        model = self.service.active_model
        fields: dict[str, object] = {
            "schema_version": SCHEMA_VERSION,
            "robot_id": self.robot_id,
            "sha256": digest(data),
            "size_bytes": len(data),
            "expected_active_sha256": model.sha256 if model is not None else "",
            "manifest": signed.manifest,
            "signature": signed.signature,
            "public_key": signed.public_key,
        }
        request = PushBegin(**(fields | changes))  # pyright: ignore[reportArgumentType]
        return PushReply.FromString(self.service.begin(request.SerializeToString()))

    def chunk(self, push_id: str, offset: int, data: bytes) -> PushReply:
        request = PushChunk(
            schema_version=SCHEMA_VERSION, push_id=push_id, offset_bytes=offset, data=data
        )
        return PushReply.FromString(self.service.chunk(request.SerializeToString()))

    def commit(self, push_id: str) -> PushReply:
        request = PushCommit(schema_version=SCHEMA_VERSION, push_id=push_id)
        return PushReply.FromString(self.service.commit(request.SerializeToString()))

    def push(
        self, data: bytes, signed: SignedManifest | None = None, **changes: object
    ) -> PushReply:
        reply = self.begin(data, signed, **changes)
        if not reply.accepted:
            return reply
        for offset in range(0, len(data), CHUNK_BYTES):
            piece = data[offset : offset + CHUNK_BYTES]
            acknowledged = self.chunk(reply.push_id, offset, piece)
            if not acknowledged.accepted:
                return acknowledged
        return self.commit(reply.push_id)

    def activate(self, sha256: str = "", key: SigningKey | None = KEY) -> ModelList:
        """Signed for the model it names, or not at all."""
        request = Activate(schema_version=SCHEMA_VERSION, robot_id=self.robot_id, sha256=sha256)
        wanted = sha256 or self.store.activation.previous
        stored = [model for model in self.store.models() if model.sha256.startswith(wanted)]
        if key is not None and wanted and stored:
            manifest = ModelManifest(
                robot_id=self.robot_id,
                sequence=next(_sequence),
                sha256=stored[0].sha256,
                size_bytes=stored[0].size_bytes,
                nonce=self.nonce(),
            )
            signed = sealed(manifest, key)
            request.manifest, request.signature = signed.manifest, signed.signature
            request.public_key = signed.public_key
        return ModelList.FromString(self.service.activate(request.SerializeToString()))

    def list(self) -> ModelList:
        return ModelList.FromString(self.service.models(b""))

    def decide_well(self) -> None:
        """As many clean decisions as prove a model."""
        for _ in range(CLEAN_DECISIONS):
            self.trial.clean()
        self.settle()

    def fail(self, reason: str = "nonsense") -> None:
        """As many failures as break it."""
        for _ in range(3):
            self.trial.failed(reason)
        self.settle()

    def settle(self) -> None:
        """Carry out the verdicts there are, which in the daemon is a thread's work."""
        verdicts = self.keeper._verdicts  # pyright: ignore[reportPrivateUsage]
        while not verdicts.empty():
            verdict = verdicts.get()
            if verdict is not None:
                self.keeper.carry_out(verdict)
