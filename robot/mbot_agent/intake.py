"""What comes in over the network in pieces, models and releases alike: whole or forgotten."""

import logging
import secrets
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

from mbot_protocol.errors import MbotError, RefusedError
from mbot_protocol.v1.messages_pb2 import PushChunk, PushReply
from mbot_protocol.wire.keys import CHUNK_BYTES
from mbot_protocol.wire.schema import SCHEMA_VERSION, decode

log = logging.getLogger(__name__)

EXPIRES_S = 15.0
"""Silence after which an unfinished push is forgotten and another one may begin."""

SENDER = "the workstation"

W = TypeVar("W")


@dataclass(slots=True)
class _Push(Generic[W]):
    """One on its way in: of what, how large, where its bytes go, and how many are here."""

    what: W
    size_bytes: int
    keep: Callable[[bytes], object]
    push_id: str
    began_s: float
    touched_s: float
    received_bytes: int = 0


class Intake(Generic[W]):
    """Pushes of one kind, one at a time. One thread uses it; any may call `expire`."""

    def __init__(self, longest_s: float, drop: Callable[[W], object]) -> None:
        """Nothing is here yet.

        Args:
            longest_s: a push may take no longer, whatever it sends: one that trickles would keep
                others out for ever.
            drop: hears of each push that has begun and comes to nothing.

        """
        self._longest_s = longest_s
        self._drop = drop
        self._push: _Push[W] | None = None
        self._lock = threading.Lock()

    def begin(
        self,
        what: W,
        size_bytes: int,
        keep: Callable[[bytes], object],
        replaces: Callable[[W], bool] = lambda _: False,
    ) -> str:
        """Let a push begin; how the sender's next messages name it.

        Args:
            what: is being pushed.
            size_bytes: of the whole.
            keep: takes each piece; what it raises, `add` raises.
            replaces: whether it takes the place of another one that is under way.

        Raises:
            RefusedError: another one is under way.

        """
        self.check_free(replaces)
        self.give_up()
        push_id, now_s = secrets.token_hex(8), time.monotonic()
        self._push = _Push(what, size_bytes, keep, push_id, now_s, now_s)
        return push_id

    def check_free(self, replaces: Callable[[W], bool] = lambda _: False) -> None:
        """Raises RefusedError where a push is under way that this one does not replace."""
        self.expire()
        push = self._push
        if push is not None and not replaces(push.what):
            raise RefusedError(f"another push is under way; try again in {EXPIRES_S:.0f} s")

    def add(self, payload: bytes, reply: PushReply) -> None:
        """Take the next chunk.

        Raises:
            RefusedError: its push is not under way, or it doesn't follow the last one, or is too
                long.

        """
        request = decode(PushChunk, payload, SENDER)
        push = self._under_way(request.push_id)
        if request.offset_bytes != push.received_bytes:
            raise RefusedError(
                f"a chunk begins at byte {request.offset_bytes}, expected {push.received_bytes}: "
                "push again"
            )
        most = min(CHUNK_BYTES, push.size_bytes - push.received_bytes)
        if not 0 < len(request.data) <= most:
            raise RefusedError(f"a chunk has {len(request.data)} bytes, expected 1 to {most}")
        push.keep(request.data)
        push.received_bytes += len(request.data)
        push.touched_s = time.monotonic()
        reply.push_id, reply.received_bytes = push.push_id, push.received_bytes

    def take(self, push_id: str, reply: PushReply) -> W:
        """What was pushed, all of which is here; the next push may begin.

        Raises:
            RefusedError: it is not under way, or some is missing and may still come.

        """
        push = self._under_way(push_id)
        if push.received_bytes != push.size_bytes:
            raise RefusedError(
                f"{push.received_bytes} of {push.size_bytes} bytes have arrived: push again"
            )
        with self._lock:
            self._push = None
        reply.push_id, reply.received_bytes = push.push_id, push.received_bytes
        return push.what

    def give_up(self) -> None:
        """Forget the push under way."""
        with self._lock:
            push, self._push = self._push, None
        if push is not None:
            self._drop(push.what)

    def expire(self) -> None:
        """Forget a push whose sender is silent or takes too long. Any thread may call it."""
        now_s = time.monotonic()
        with self._lock:
            push = self._push
            if push is None:
                return
            silent = now_s - push.touched_s > EXPIRES_S
            if not (silent or now_s - push.began_s > self._longest_s):
                return
            self._push = None
        self._drop(push.what)

    def _under_way(self, push_id: str) -> _Push[W]:
        self.expire()
        push = self._push
        if push is None or push.push_id != push_id:
            raise RefusedError("this push is not under way (any more): push again")
        return push


def replied(noun: str, act: Callable[[PushReply], None]) -> bytes:
    """The reply to a step of a push: what `act` makes of it, or why it is refused."""
    reply = PushReply(schema_version=SCHEMA_VERSION)
    try:
        act(reply)
        reply.accepted = True
    except MbotError as error:
        log.warning("%s refused: %s", noun, error)
        reply.reason = str(error)
    return reply.SerializeToString()
