"""Send a model to a robot: checked, signed with the robot's nonce, and in pieces.

Until the commit the robot keeps driving with the model it has.
"""

import time
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

from mbot_protocol.errors import RefusedError
from mbot_protocol.signing.envelope import MODEL
from mbot_protocol.signing.model_manifest import ModelManifest, decode, encode
from mbot_protocol.v1.messages_pb2 import Activate, Model, PushBegin, PushNonce, PushNonceReply
from mbot_protocol.wire.keys import PUSH_BEGIN, PUSH_CHUNK, PUSH_COMMIT, PUSH_NONCE
from mbot_protocol.wire.schema import SCHEMA_VERSION, MalformedMessageError
from mbot_workstation.fleet.link.pieces import Progress, PushKind, accepted, push_in_pieces
from mbot_workstation.fleet.link.robot_link import RobotLink
from mbot_workstation.fleet.models.check import CheckedModel, check_model
from mbot_workstation.fleet.models.key_choice import ChooseKey
from mbot_workstation.fleet.models.signing_key import SigningKey
from mbot_workstation.wording import one_line

COMMIT_TIMEOUT_S = 60.0
"""The robot verifies the model and dry-runs it in a process of its own before it answers."""

MANIFEST_LIFE_S = 86_400
"""After a day no robot whose clock is set takes a manifest, whatever else fails; the nonce ends it
after a minute. A day, because people's clocks are wrong by hours (time zones)."""


@dataclass(frozen=True, slots=True)
class Pushed:
    """What came of a push.

    Attributes:
        model: the robot's active model, which is now the one that was pushed.
        advice: what the robot finds allowed but doubtful; mostly empty.
        was_sent: false if the robot had this very model active already.

    """

    model: Model
    advice: str
    was_sent: bool = True


PUSH = PushKind(
    PUSH_BEGIN, PUSH_CHUNK, PUSH_COMMIT, COMMIT_TIMEOUT_S, "refused the model and keeps its own"
)


def push(
    link: RobotLink,
    path: Path,
    choose_key: ChooseKey,
    on_progress: Progress = lambda _sent, _all: None,
) -> Pushed:
    """Check a model file, sign and send it, and have the robot make it active.

    If the robot already drives with this very model, nothing is sent.

    Raises:
        ConfigurationError, ContractError, NewerSchemaError: the file is not fit to be sent.
        RefusedError: no key of ours would do, or the robot says why it does not take the model;
            it keeps the one it has.
        UnreachableError: the link broke; unless that was during the commit, the robot keeps the
            model it has.

    """
    return push_checked(link, check_model(path), choose_key, on_progress)


def push_checked(
    link: RobotLink,
    model: CheckedModel,
    choose_key: ChooseKey,
    on_progress: Progress,
    *,
    allow_downgrade: bool = False,
) -> Pushed:
    """As `push`, with a model that was checked before.

    With `allow_downgrade` the robot takes it though this key has signed higher numbers already.

    Raises:
        RefusedError, UnreachableError: as `push`.
        MalformedMessageError: the robot's replies contradict what was sent.

    """
    status = link.status()
    active = status.active_model
    size_bytes = len(model.data)
    if active.sha256 == model.sha256:
        on_progress(size_bytes, size_bytes)
        return Pushed(active, "", was_sent=False)
    request = PushBegin(
        schema_version=SCHEMA_VERSION,
        robot_id=link.robot_id,
        sha256=model.sha256,
        size_bytes=size_bytes,
        expected_active_sha256=active.sha256,
    )
    try:
        key = choose_key(status)
    except RefusedError as no_key:  # who may not push need not see to keys
        raise link.refused(PUSH_BEGIN) or no_key from None
    if key is not None:
        sign_for_once(link, request, size_bytes, key, allow_downgrade=allow_downgrade)
    reply = push_in_pieces(link, PUSH, request, BytesIO(model.data), size_bytes, on_progress)
    if reply.active_model.sha256 != model.sha256:
        raise MalformedMessageError(
            f"robot {link.robot_id} took the model but names another one as active; look at "
            "`workstation models`"
        )
    return Pushed(reply.active_model, one_line(reply.reason))


def sign_for_once(
    link: RobotLink,
    request: PushBegin | Activate,
    size_bytes: int,
    key: SigningKey,
    *,
    allow_downgrade: bool = False,
) -> None:
    """Put the signed manifest of a model into the request, good for this one alone.

    Raises:
        RefusedError: the robot gives no nonce, and says why.
        UnreachableError: it does not answer.

    """
    ask = PushNonce(schema_version=SCHEMA_VERSION, robot_id=link.robot_id)
    reply = accepted(link, PUSH, link.query(PUSH_NONCE, ask, PushNonceReply))
    manifest = ModelManifest(
        robot_id=link.robot_id,
        sequence=key.next_sequence(),
        sha256=request.sha256,
        size_bytes=size_bytes,
        nonce=reply.nonce,
        not_after_unix_s=int(time.time()) + MANIFEST_LIFE_S,
        allow_downgrade=allow_downgrade,
    )
    data = encode(manifest)
    decode(data)  # the nonce comes from outside: sign nothing that is not a manifest
    signed = key.sign(MODEL, data)
    request.manifest, request.signature = data, signed.signature
    request.public_key = signed.public_key
