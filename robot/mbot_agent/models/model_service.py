"""Answers `models/...`: takes a pushed model in, tries it, and has it stored and made active.

The old model drives on until the new one has passed everything. One push is staged at a time, in
memory; nothing of it touches the disk before it is whole. The order is always the same: sizes,
signature, what the manifest says, digest, and only then does anything parse the model, first of
all in a process of its own.
"""

import hashlib
import hmac
import logging
import re
import shutil
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

from mbot_agent.configuration import Configuration
from mbot_agent.intake import SENDER, Intake, replied
from mbot_agent.models.model_directory import ModelDirectory, StoredModel
from mbot_agent.models.model_keeper import ModelKeeper
from mbot_agent.models.trust import Admission, Trust
from mbot_protocol.errors import MbotError, RefusedError
from mbot_protocol.policy.dry_run import Report, dry_run
from mbot_protocol.policy.policy import Policy
from mbot_protocol.policy.policy_contract import LARGEST_MODEL_BYTES
from mbot_protocol.v1 import messages_pb2 as messages
from mbot_protocol.wire import keys
from mbot_protocol.wire.schema import SCHEMA_VERSION, decode

log = logging.getLogger(__name__)

DISK_RESERVE_BYTES = 4 << 20

LONGEST_S = 60.0
"""The largest model (16 MiB) then needs 280 kB/s."""

TryModel = Callable[[bytes, float], Report]
"""As `dry_run`."""


@dataclass(frozen=True, slots=True)
class _Pushed:
    """A model on its way in.

    Attributes:
        sha256: of the model, as announced.
        expected_active: the digest that was active when it began.
        admission: why it was let in.
        data: what is here.

    """

    sha256: str
    expected_active: str
    admission: Admission
    data: bytearray = field(default_factory=bytearray)


class ModelService:
    """The replies. Used by one thread but for `expire_staging` and `active_model`."""

    def __init__(
        self,
        configuration: Configuration,
        store: ModelDirectory,
        keeper: ModelKeeper,
        trust: Trust,
        try_model: TryModel | None = None,
    ) -> None:
        self._robot_id = configuration.robot_id
        self._rate_hz = configuration.control.decision_rate_hz
        self._directory = configuration.models.path
        self._store = store
        self._keeper = keeper
        self._trust = trust
        self._try = try_model or partial(dry_run, model_s=configuration.models.dry_run_s)
        self._intake = Intake[_Pushed](LONGEST_S, _say_unfinished)

    @property
    def answers(self) -> dict[str, Callable[[bytes], bytes]]:
        """What answers which key below `models/`."""
        return {
            keys.PUSH_NONCE.name: self.nonce,
            keys.PUSH_BEGIN.name: self.begin,
            keys.PUSH_CHUNK.name: self.chunk,
            keys.PUSH_COMMIT.name: self.commit,
            keys.MODELS.name: self.models,
            keys.ACTIVATE.name: self.activate,
        }

    @property
    def active_model(self) -> messages.Model | None:
        """The model the robot decides with."""
        in_use = self._keeper.in_use
        if in_use is None:
            return None
        policy = in_use.policy
        return messages.Model(
            sha256=policy.sha256,
            name=policy.metadata.name,
            size_bytes=policy.size_bytes,
            stored_unix_time_ns=in_use.stored_unix_time_ns,
            active=True,
            decision_rate_hz=policy.metadata.decision_rate_hz,
            signed_by=in_use.signer,
            proven=in_use.proven,
        )

    def expire_staging(self) -> None:
        """Free the memory of a push whose sender has fallen silent. Any thread may call it."""
        self._intake.expire()

    def nonce(self, payload: bytes) -> bytes:
        """Reply to `models/push/nonce`."""
        reply = messages.PushNonceReply(schema_version=SCHEMA_VERSION)
        try:
            self._check_robot(decode(messages.PushNonce, payload, SENDER).robot_id)
            reply.nonce = self._trust.new_nonce()
            reply.accepted = True
        except MbotError as error:
            reply.reason = str(error)
        return reply.SerializeToString()

    def begin(self, payload: bytes) -> bytes:
        """Reply to `models/push/begin`."""
        return replied("push", lambda reply: self._begin(payload, reply))

    def chunk(self, payload: bytes) -> bytes:
        """Reply to `models/push/chunk`."""
        return replied("push", lambda reply: self._intake.add(payload, reply))

    def commit(self, payload: bytes) -> bytes:
        """Reply to `models/push/commit`."""
        return replied("push", lambda reply: self._commit(payload, reply))

    def models(self, _: bytes) -> bytes:
        """Reply to `models/list`."""
        return self._list_reply(lambda: None)

    def activate(self, payload: bytes) -> bytes:
        """Reply to `models/activate`: a stored model, or the previous one, becomes active."""
        return self._list_reply(lambda: self._activate(payload))

    def _list_reply(self, act: Callable[[], None]) -> bytes:
        reply = messages.ModelList(schema_version=SCHEMA_VERSION)
        try:
            act()
            reply.models.extend(self._describe(model) for model in self._store.models())
            reply.accepted = True
        except MbotError as error:
            log.warning("activation refused: %s", error)
            reply.reason = str(error)
        return reply.SerializeToString()

    def _begin(self, payload: bytes, reply: messages.PushReply) -> None:
        request = decode(messages.PushBegin, payload, SENDER)
        self._check_robot(request.robot_id)
        if not re.fullmatch(r"[0-9a-f]{64}", request.sha256):
            raise RefusedError(f"sha256 is {request.sha256[:80]!r}, expected 64 hexadecimal digits")
        if not 0 < request.size_bytes <= LARGEST_MODEL_BYTES:
            raise RefusedError(
                f"the model has {request.size_bytes} bytes, expected 1 to {LARGEST_MODEL_BYTES}"
            )
        admission = self._trust.admit(request)
        self._keeper.check_active(request.expected_active_sha256)
        try:
            free_bytes = shutil.disk_usage(self._directory).free
        except OSError as error:
            raise RefusedError(f"cannot use {self._directory}: {error.strerror}") from None
        needed_bytes = request.size_bytes + DISK_RESERVE_BYTES
        if free_bytes < needed_bytes:
            raise RefusedError(self._store.no_room(needed_bytes, free_bytes))
        pushed = _Pushed(request.sha256, request.expected_active_sha256, admission)
        reply.push_id = self._intake.begin(
            pushed,
            request.size_bytes,
            pushed.data.extend,
            replaces=lambda other: other.sha256 == pushed.sha256,
        )

    def _commit(self, payload: bytes, reply: messages.PushReply) -> None:
        pushed = self._intake.take(decode(messages.PushCommit, payload, SENDER).push_id, reply)
        data = bytes(pushed.data)
        pushed.data.clear()  # or the model would be there twice while it is tried
        if not hmac.compare_digest(hashlib.sha256(data).hexdigest(), pushed.sha256):
            raise RefusedError("the bytes do not match their digest: push again")
        self._keeper.check_active(pushed.expected_active)
        report = self._try(data, self._rate_hz)
        log.info(
            "model %s tried: %.1f ms a decision, %d golden frames right",
            pushed.sha256[:12],
            report.inference_ms,
            report.golden_frames,
        )
        if not report.confined:
            log.warning(
                "this kernel or machine confines no process: the trial could do as it likes"
            )
        policy = self._keeper.install(data, pushed.expected_active, pushed.admission)
        reply.reason = self._advice(policy)
        reply.active_model.CopyFrom(self.active_model or messages.Model())

    def _activate(self, payload: bytes) -> None:
        request = decode(messages.Activate, payload, SENDER)
        self._check_robot(request.robot_id)
        sha256 = self._keeper.find(request.sha256)
        # Going back needs the word that a push needs: a key that the robot trusts, for this model
        # and this one time. Otherwise whoever may push could bring back what was replaced for a
        # reason, without a key.
        admission = self._trust.admit(
            messages.PushBegin(
                sha256=sha256,
                size_bytes=self._store.size_bytes(sha256),
                manifest=request.manifest,
                signature=request.signature,
                public_key=request.public_key,
            )
        )
        self._keeper.activate(sha256, admission)

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
        activation = self._store.activation
        active = stored.sha256 == self._keeper.active_sha256
        try:
            signer = self._trust.signer_of(stored.sha256, stored.label)
        except MbotError:
            signer = ""
        return messages.Model(
            sha256=stored.sha256,
            name=stored.label.name,
            size_bytes=stored.size_bytes,
            stored_unix_time_ns=stored.stored_unix_time_ns,
            active=active,
            previous=stored.sha256 == activation.previous and not active,
            decision_rate_hz=stored.label.decision_rate_hz,
            signed_by=signer,
            proven=stored.sha256 in activation.proven,
            rejected=stored.sha256 in activation.rejected,
        )

    def _check_robot(self, robot_id: str) -> None:
        if robot_id != self._robot_id:
            raise RefusedError(
                f"the model is for robot {robot_id!r}, this one is {self._robot_id!r}"
            )


def _say_unfinished(pushed: _Pushed) -> None:
    log.warning("a push of %s was never finished", pushed.sha256[:12])
