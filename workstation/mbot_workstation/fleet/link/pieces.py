"""Send a model or a release to a robot: begin, acknowledged chunks, commit.

Until the commit nothing changes there, and whatever was sent of an interrupted push expires; so
breaking off at any point is safe.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import IO, Protocol, TypeVar

from google.protobuf.message import Message

from mbot_protocol.errors import RefusedError
from mbot_protocol.v1.messages_pb2 import PushChunk, PushCommit, PushNonceReply, PushReply
from mbot_protocol.wire.keys import CHUNK_BYTES, Topic
from mbot_protocol.wire.schema import SCHEMA_VERSION, MalformedMessageError
from mbot_workstation.fleet.link.robot_link import QUERY_TIMEOUT_S, M
from mbot_workstation.wording import one_line

CHUNK_TIMEOUT_S = 10.0

Progress = Callable[[int, int], None]
"""Called with the bytes acknowledged and the bytes in all."""

R = TypeVar("R", PushReply, PushNonceReply)


class Link(Protocol):
    """What of a `RobotLink` is needed here."""

    @property
    def robot_id(self) -> str:
        """Whose it is."""
        ...

    def query(
        self,
        topic: Topic,
        request: Message | None,
        reply_type: type[M],
        timeout_s: float = QUERY_TIMEOUT_S,
    ) -> M:
        """Ask the robot and wait for its one reply."""
        ...


@dataclass(frozen=True, slots=True)
class PushKind:
    """What is pushed.

    Attributes:
        begin, chunk, commit: where the robot takes it.
        commit_timeout_s: what the robot may need before it answers the last one.
        refused: what a robot does that does not take it: "refused the model and keeps its own".

    """

    begin: Topic
    chunk: Topic
    commit: Topic
    commit_timeout_s: float
    refused: str


def push_in_pieces(
    link: Link,
    kind: PushKind,
    begin: Message,
    content: IO[bytes],
    size_bytes: int,
    on_progress: Progress,
) -> PushReply:
    """Send it all, one chunk at a time: the next leaves when the robot has acknowledged, so a STOP
    gets through.

    Returns:
        The robot's last reply.

    Raises:
        RefusedError: the robot says why it does not take it.
        UnreachableError: the link broke.
        MalformedMessageError: the robot's replies contradict what was sent.

    """
    push_id = accepted(link, kind, link.query(kind.begin, begin, PushReply)).push_id
    sent = 0
    while piece := content.read(CHUNK_BYTES):
        chunk = PushChunk(
            schema_version=SCHEMA_VERSION, push_id=push_id, offset_bytes=sent, data=piece
        )
        reply = accepted(link, kind, link.query(kind.chunk, chunk, PushReply, CHUNK_TIMEOUT_S))
        sent += len(piece)
        if reply.received_bytes != sent:
            raise MalformedMessageError(
                f"robot {link.robot_id} has {reply.received_bytes} bytes of it, expected {sent}; "
                "push again"
            )
        on_progress(sent, size_bytes)
    commit = PushCommit(schema_version=SCHEMA_VERSION, push_id=push_id)
    reply = link.query(kind.commit, commit, PushReply, kind.commit_timeout_s)
    return accepted(link, kind, reply)


def accepted(link: Link, kind: PushKind, reply: R) -> R:
    """The reply, if the robot goes along.

    Raises:
        RefusedError: it does not, and says why.

    """
    if not reply.accepted:
        raise RefusedError(f"robot {link.robot_id} {kind.refused}: {one_line(reply.reason)}")
    return reply
