"""Send a model to a robot: begin, acknowledged chunks, commit.

Until the commit the robot keeps driving with the model it has, and whatever was sent of an
interrupted push expires there; so breaking off at any point is safe.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from mbot_protocol.errors import RefusedError
from mbot_protocol.keys import CHUNK_BYTES, PUSH_BEGIN, PUSH_CHUNK, PUSH_COMMIT
from mbot_protocol.schema import SCHEMA_VERSION, MalformedMessageError
from mbot_protocol.v1.messages_pb2 import Model, PushBegin, PushChunk, PushCommit, PushReply
from mbot_workstation.model_check import CheckedModel, check_model
from mbot_workstation.robot_link import RobotLink
from mbot_workstation.wording import one_line

CHUNK_TIMEOUT_S = 10.0
COMMIT_TIMEOUT_S = 60.0
"""The robot verifies the model and dry-runs it in a process of its own before it answers."""


@dataclass(frozen=True, slots=True)
class Pushed:
    """What came of a push.

    Attributes:
        model: the robot's active model, which is now the one that was pushed.
        advice: what the robot finds allowed but doubtful; mostly empty.

    """

    model: Model
    advice: str


Progress = Callable[[int, int], None]
"""Called with the bytes acknowledged and the bytes in all."""


def push(link: RobotLink, path: Path, on_progress: Progress = lambda _sent, _all: None) -> Pushed:
    """Check a model file, send it, and have the robot make it active.

    If the robot already drives with this very model, nothing is sent.

    Raises:
        ConfigurationError, ContractError, NewerSchemaError: the file is not fit to be sent.
        RefusedError: the robot says why it does not take it; it keeps the model it has.
        UnreachableError: the link broke; unless that was during the commit, the robot keeps the
            model it has.

    """
    return push_checked(link, check_model(path), on_progress)


def push_checked(link: RobotLink, model: CheckedModel, on_progress: Progress) -> Pushed:
    """As `push`, with a model that was checked before."""
    active = link.status().active_model
    size_bytes = len(model.data)
    if active.sha256 == model.sha256:
        on_progress(size_bytes, size_bytes)
        return Pushed(active, "")
    begun = _accepted(
        link,
        link.query(
            PUSH_BEGIN,
            PushBegin(
                schema_version=SCHEMA_VERSION,
                robot_id=link.robot_id,
                sha256=model.sha256,
                size_bytes=size_bytes,
                expected_active_sha256=active.sha256,
            ),
            PushReply,
        ),
    )
    _send_chunks(link, begun.push_id, model.data, on_progress)
    commit = PushCommit(schema_version=SCHEMA_VERSION, push_id=begun.push_id)
    reply = _accepted(link, link.query(PUSH_COMMIT, commit, PushReply, COMMIT_TIMEOUT_S))
    if reply.active_model.sha256 != model.sha256:
        raise MalformedMessageError(
            f"robot {link.robot_id} took the model but names another one as active; look at "
            "`workstation models`"
        )
    return Pushed(reply.active_model, one_line(reply.reason))


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


def _accepted(link: RobotLink, reply: PushReply) -> PushReply:
    if not reply.accepted:
        raise RefusedError(
            f"robot {link.robot_id} refused the model and keeps its own: {one_line(reply.reason)}"
        )
    return reply
