"""Answers `stop`: whoever may see the robot may stop it, and no number of STOPs holds one up.

One thread acts, and waits for nothing but the helm. Another one asks the board whether the wheels
stand, once for all STOPs that have come meanwhile, and answers them: each look takes the board
12 ms of wire, and a flood of STOPs must not keep somebody else's from being confirmed.
"""

import logging
import threading
import time

from google.protobuf.message import DecodeError

from mbot_agent.hardware import Board
from mbot_agent.helm import Helm
from mbot_agent.network.requests import Request
from mbot_agent.network.zenoh_link import Link, Listener
from mbot_protocol.v1 import messages_pb2 as messages
from mbot_protocol.wire import keys
from mbot_protocol.wire.schema import SCHEMA_VERSION

log = logging.getLogger(__name__)

STANDING_WAIT_S = 0.08
"""The board acknowledges a stop after 12 ms of wire; a STOP is answered within 100 ms anyway."""

MOST_WAITING = 512
"""STOPs that have come in and were not acted on yet. Acting on one takes some 50 us."""

REPLY_THREADS = 16
"""A peer that does not read holds one for 200 ms (zenoh_settings), and a name has four sessions."""

LONGEST_NAME = 48

PULSE = f"{keys.STOP.name}/pulse"
"""The daemon's own question whether it hears anybody; nobody else reaches this key. Not on `stop`
itself, where a flood would keep it waiting and get the daemon restarted."""


class StopService:
    """Two threads; all state is the helm's."""

    def __init__(self, helm: Helm, board: Board) -> None:
        self._helm = helm
        self._board = board
        self._news = threading.Condition()
        self._unanswered: list[Request] = []
        self._confirming_since_ns: int | None = None
        self._listener: Listener | None = None

    def serve(self, link: Link) -> None:
        """Stop the robot from now on, whoever asks for it."""
        self._listener = link.listen(
            keys.STOP.name, self.take, most_waiting=MOST_WAITING, reply_threads=REPLY_THREADS
        )
        link.serve({PULSE: lambda _: b"alive"})
        threading.Thread(target=self._confirm_all, name="confirm stop", daemon=True).start()

    @property
    def progress_ns(self) -> int:
        """When both threads were last seen to work, monotonic."""
        acting = self._listener.progress_ns if self._listener is not None else time.monotonic_ns()
        confirming = self._confirming_since_ns
        return acting if confirming is None else min(acting, confirming)

    def take(self, request: Request) -> None:
        """Stop, whatever was sent: no clock, no schema and no damaged message stands between
        anybody and a stop."""
        self._helm.stop(_sender(request.payload))
        with self._news:
            self._unanswered.append(request)
            self._news.notify()

    def confirm(self) -> messages.CommandReply:
        """What all are answered who have been stopping the robot until now."""
        standing = self._board.stands(STANDING_WAIT_S)
        reply = messages.CommandReply(
            schema_version=SCHEMA_VERSION,
            accepted=True,
            state=messages.STATE_STOPPED,
            stop_count=self._helm.orders.stop.count,
            standing=standing,
        )
        if not standing:
            fault = self._board.fault
            found = "the board does not answer in time" if fault is None else fault.detail
            reply.reason = f"disarmed, but not confirmed by the board: {found}"
        return reply

    def _confirm_all(self) -> None:
        while True:
            with self._news:
                self._news.wait_for(lambda: bool(self._unanswered))
                waiting, self._unanswered = self._unanswered, []
            self._confirming_since_ns = time.monotonic_ns()
            reply = self.confirm().SerializeToString()
            for request in waiting:
                request.answer(reply)
            self._confirming_since_ns = None


def name_in_a_line(name: str) -> str:
    """A sender's name for themselves, fit for a log."""
    return "".join(sign for sign in name if sign.isprintable())[:LONGEST_NAME]


def _sender(payload: bytes) -> str:
    """Who says to have sent a STOP; empty if that can't be read."""
    try:
        return name_in_a_line(messages.Command.FromString(payload).sender)
    except DecodeError:
        return ""
