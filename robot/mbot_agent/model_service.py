"""Answers `models/...`: takes a pushed model in, tries it, stores it and makes it the active one.

The old model drives on until the new one has passed everything. One push is staged at a time,
in memory; nothing of it touches the disk before it is whole.
"""

import hashlib
import hmac
import logging
import re
import secrets
import shutil
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from mbot_agent.configuration import Configuration
from mbot_agent.dry_run import dry_run
from mbot_agent.model_store import Label, ModelStore, StoredModel
from mbot_agent.policy import Policy
from mbot_protocol.errors import ContractError, MbotError, RefusedError
from mbot_protocol.keys import CHUNK_BYTES
from mbot_protocol.policy_contract import LARGEST_MODEL_BYTES
from mbot_protocol.schema import SCHEMA_VERSION, decode
from mbot_protocol.v1 import messages_pb2 as messages

log = logging.getLogger(__name__)

STAGING_EXPIRES_S = 15.0
"""Silence after which an unfinished push is forgotten and another one may begin."""

DISK_RESERVE_BYTES = 4 << 20

_SENDER = "the workstation"


@dataclass(slots=True)
class _Staging:
    sha256: str
    size_bytes: int
    expected_active: str
    touched_s: float
    push_id: str = field(default_factory=lambda: secrets.token_hex(8))
    data: bytearray = field(default_factory=bytearray)


class ModelService:
    """Owns the model store and the staging. Used by one thread after `load_active`."""

    def __init__(
        self, configuration: Configuration, store: ModelStore, use: Callable[[Policy], None]
    ) -> None:
        """`use` hands a policy to the control loop, which switches between two decisions."""
        self._robot_id = configuration.robot_id
        self._rate_hz = configuration.control.decision_rate_hz
        self._directory = configuration.models.path
        self._store = store
        self._use = use
        self._staging: _Staging | None = None
        self._active: messages.Model | None = None
        self._active_sha256 = ""

    @property
    def active_model(self) -> messages.Model | None:
        """The model the robot decides with."""
        return self._active

    def load_active(self) -> None:
        """At start: use the active model, or the previous one if the active one is damaged."""
        pointer = self._store.pointer
        for sha256 in (pointer.active, pointer.previous):
            if not sha256:
                continue
            try:
                policy = Policy(self._store.read(sha256))
            except MbotError as error:
                log.error("model %s cannot be used: %s", sha256[:12], error)
                continue
            self._adopt(policy)
            return
        log.warning("no model yet: `workstation push-model` sends one")

    def expire_staging(self) -> None:
        """Free the memory of a push whose sender has fallen silent. Any thread may call it."""
        staging = self._staging
        if staging is not None and time.monotonic() - staging.touched_s > STAGING_EXPIRES_S:
            log.warning("a push of %s was never finished", staging.sha256[:12])
            self._staging = None

    def begin(self, payload: bytes) -> bytes:
        """Reply to `models/push/begin`."""
        return self._push_reply(lambda reply: self._begin(payload, reply))

    def chunk(self, payload: bytes) -> bytes:
        """Reply to `models/push/chunk`."""
        return self._push_reply(lambda reply: self._chunk(payload, reply))

    def commit(self, payload: bytes) -> bytes:
        """Reply to `models/push/commit`."""
        return self._push_reply(lambda reply: self._commit(payload, reply))

    def models(self, _: bytes) -> bytes:
        """Reply to `models/list`."""
        return self._list_reply(lambda: None)

    def activate(self, payload: bytes) -> bytes:
        """Reply to `models/activate`: a stored model, or the previous one, becomes active."""
        return self._list_reply(lambda: self._activate(payload))

    def _push_reply(self, act: Callable[[messages.PushReply], None]) -> bytes:
        reply = messages.PushReply(schema_version=SCHEMA_VERSION)
        try:
            act(reply)
            reply.accepted = True
        except MbotError as error:
            log.warning("push refused: %s", error)
            reply.reason = str(error)
        return reply.SerializeToString()

    def _list_reply(self, act: Callable[[], None]) -> bytes:
        reply = messages.ModelList(schema_version=SCHEMA_VERSION)
        try:
            act()
            reply.accepted = True
        except MbotError as error:
            log.warning("activation refused: %s", error)
            reply.reason = str(error)
        reply.models.extend(self._describe(model) for model in self._store.models())
        return reply.SerializeToString()

    def _begin(self, payload: bytes, reply: messages.PushReply) -> None:
        request = decode(messages.PushBegin, payload, _SENDER)
        self._check_robot(request.robot_id)
        if not re.fullmatch(r"[0-9a-f]{64}", request.sha256):
            raise RefusedError(f"sha256 is {request.sha256[:80]!r}, expected 64 hexadecimal digits")
        if not 0 < request.size_bytes <= LARGEST_MODEL_BYTES:
            raise RefusedError(
                f"the model has {request.size_bytes} bytes, expected 1 to {LARGEST_MODEL_BYTES}"
            )
        self._check_active(request.expected_active_sha256)
        free_bytes = shutil.disk_usage(self._directory).free
        if free_bytes < request.size_bytes + DISK_RESERVE_BYTES:
            raise RefusedError(f"only {free_bytes} bytes are free in {self._directory}")
        self.expire_staging()
        if self._staging is not None and self._staging.sha256 != request.sha256:
            raise RefusedError(f"another push is under way; try again in {STAGING_EXPIRES_S:.0f} s")
        self._staging = _Staging(
            request.sha256, request.size_bytes, request.expected_active_sha256, time.monotonic()
        )
        reply.push_id = self._staging.push_id

    def _chunk(self, payload: bytes, reply: messages.PushReply) -> None:
        request = decode(messages.PushChunk, payload, _SENDER)
        staging = self._staged(request.push_id)
        received = len(staging.data)
        if request.offset_bytes != received:
            raise RefusedError(
                f"a chunk begins at byte {request.offset_bytes}, expected {received}: push again"
            )
        if not 0 < len(request.data) <= min(CHUNK_BYTES, staging.size_bytes - received):
            raise RefusedError(
                f"a chunk has {len(request.data)} bytes, expected 1 to "
                f"{min(CHUNK_BYTES, staging.size_bytes - received)}"
            )
        staging.data += request.data
        staging.touched_s = time.monotonic()
        reply.push_id = staging.push_id
        reply.received_bytes = len(staging.data)

    def _commit(self, payload: bytes, reply: messages.PushReply) -> None:
        request = decode(messages.PushCommit, payload, _SENDER)
        staging = self._staged(request.push_id)
        self._staging = None
        data = bytes(staging.data)
        if len(data) != staging.size_bytes:
            raise RefusedError(
                f"{len(data)} of {staging.size_bytes} bytes have arrived: push again"
            )
        # Here a signed manifest will be verified, before anything parses the bytes.
        if not hmac.compare_digest(hashlib.sha256(data).hexdigest(), staging.sha256):
            raise RefusedError("the bytes do not match their digest: push again")
        self._check_active(staging.expected_active)
        self._try(data)
        policy = Policy(data)
        label = Label(policy.metadata.name, policy.metadata.decision_rate_hz)
        self._store.add(policy.sha256, data, label)
        self._store.activate(policy.sha256)
        self._adopt(policy)
        reply.push_id = staging.push_id
        reply.received_bytes = len(data)
        reply.reason = self._advice(policy)
        reply.active_model.CopyFrom(self._active or messages.Model())

    def _try(self, data: bytes) -> None:
        """Dry-run the model in a child process, from a file that is gone afterwards."""
        try:
            with tempfile.NamedTemporaryFile(suffix=".onnx") as file:
                file.write(data)
                file.flush()
                dry_run(Path(file.name))
        except OSError as error:
            raise RefusedError(f"cannot try the model: {error.strerror}") from None

    def _activate(self, payload: bytes) -> None:
        request = decode(messages.Activate, payload, _SENDER)
        self._check_robot(request.robot_id)
        sha256 = (
            self._store.find(request.sha256) if request.sha256 else self._store.pointer.previous
        )
        if not sha256:
            raise RefusedError("there is no previous model to roll back to")
        try:
            policy = Policy(self._store.read(sha256))
        except ContractError as error:
            raise RefusedError(str(error)) from None
        self._store.activate(sha256)
        self._adopt(policy)

    def _adopt(self, policy: Policy) -> None:
        self._use(policy)
        stored = next(m for m in self._store.models() if m.sha256 == policy.sha256)
        self._active_sha256 = policy.sha256
        self._active = self._describe(stored)
        log.info("model %s (%s) is active", policy.sha256[:12], policy.metadata.name)
        if advice := self._advice(policy):
            log.warning("%s", advice)

    def _advice(self, policy: Policy) -> str:
        """A word on what is allowed but doubtful; empty if all is well."""
        trained_hz = policy.metadata.decision_rate_hz
        if abs(trained_hz - self._rate_hz) < 1e-6:
            return ""
        return (
            f"the model was made for {trained_hz:g} decisions/s, this robot makes "
            f"{self._rate_hz:g} (control.decision_rate_hz)"
        )

    def _describe(self, stored: StoredModel) -> messages.Model:
        active = stored.sha256 == self._active_sha256
        return messages.Model(
            sha256=stored.sha256,
            name=stored.label.name,
            size_bytes=stored.size_bytes,
            stored_unix_time_ns=stored.stored_unix_time_ns,
            active=active,
            previous=stored.sha256 == self._store.pointer.previous and not active,
            decision_rate_hz=stored.label.decision_rate_hz,
        )

    def _staged(self, push_id: str) -> _Staging:
        self.expire_staging()
        if self._staging is None or self._staging.push_id != push_id:
            raise RefusedError("this push is not under way (any more): push again")
        return self._staging

    def _check_robot(self, robot_id: str) -> None:
        if robot_id != self._robot_id:
            raise RefusedError(
                f"the model is for robot {robot_id!r}, this one is {self._robot_id!r}"
            )

    def _check_active(self, expected_sha256: str) -> None:
        active = self._active_sha256
        if active != expected_sha256:
            raise RefusedError(
                f"another model ({active[:12] or 'none'}) has become active meanwhile: look at "
                "`workstation models` and push again"
            )
