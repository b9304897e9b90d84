"""Send a model to a robot: a nonce to sign, begin, acknowledged chunks, commit.

Until the commit the robot keeps driving with the model it has, and whatever was sent of an
interrupted push expires there; so breaking off at any point is safe.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from mbot_protocol.errors import RefusedError
from mbot_protocol.signing.model_manifest import ModelManifest, decode, encode
from mbot_protocol.v1.messages_pb2 import (
    Activate,
    Model,
    PushBegin,
    PushChunk,
    PushCommit,
    PushNonce,
    PushNonceReply,
    PushReply,
)
from mbot_protocol.wire.keys import CHUNK_BYTES, PUSH_BEGIN, PUSH_CHUNK, PUSH_COMMIT, PUSH_NONCE
from mbot_protocol.wire.schema import SCHEMA_VERSION, MalformedMessageError
from mbot_workstation.fleet.link.robot_link import RobotLink
from mbot_workstation.fleet.models.check import CheckedModel, check_model
from mbot_workstation.fleet.models.key_choice import ChooseKey
from mbot_workstation.fleet.models.signing_key import SigningKey
from mbot_workstation.wording import one_line

CHUNK_TIMEOUT_S = 10.0
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


R = TypeVar("R", PushReply, PushNonceReply)

Progress = Callable[[int, int], None]
"""Called with the bytes acknowledged and the bytes in all."""


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
    key = choose_key(status)
    if key is not None:
        sign_for_once(link, request, size_bytes, key, allow_downgrade=allow_downgrade)
    begun = _accepted(link, link.query(PUSH_BEGIN, request, PushReply))
    _send_chunks(link, begun.push_id, model.data, on_progress)
    commit = PushCommit(schema_version=SCHEMA_VERSION, push_id=begun.push_id)
    reply = _accepted(link, link.query(PUSH_COMMIT, commit, PushReply, COMMIT_TIMEOUT_S))
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
    reply = _accepted(link, link.query(PUSH_NONCE, ask, PushNonceReply))
    manifest = ModelManifest(
        robot_id=link.robot_id,
        sequence=key.next_sequence(),
        sha256=request.sha256,
        size_bytes=size_bytes,
        nonce=reply.nonce,
        not_after_unix_s=int(time.time()) + MANIFEST_LIFE_S,
        allow_downgrade=allow_downgrade,
    )
    decode(encode(manifest))  # the nonce comes from outside: sign nothing that is not a manifest
    signed = key.sign(manifest)
    request.manifest, request.signature = signed.manifest, signed.signature
    request.public_key = signed.public_key


def _send_chunks(link: RobotLink, push_id: str, data: bytes, on_progress: Progress) -> None:
    """One at a time: the next leaves when the robot has acknowledged, so a STOP gets through."""
    for offset in range(0, len(data), CHUNK_BYTES):
        piece = data[offset : offset + CHUNK_BYTES]
        chunk = PushChunk(
            schema_version=SCHEMA_VERSION, push_id=push_id, offset_bytes=offset, data=piece
        )
        reply = _accepted(link, link.query(PUSH_CHUNK, chunk, PushReply, CHUNK_TIMEOUT_S))
        if reply.received_bytes != offset + len(piece):
            raise MalformedMessageError(
                f"robot {link.robot_id} has {reply.received_bytes} bytes of the model, expected "
                f"{offset + len(piece)}; push again"
            )
        on_progress(reply.received_bytes, len(data))


def _accepted(link: RobotLink, reply: R) -> R:
    if not reply.accepted:
        raise RefusedError(
            f"robot {link.robot_id} refused the model and keeps its own: {one_line(reply.reason)}"
        )
    return reply
