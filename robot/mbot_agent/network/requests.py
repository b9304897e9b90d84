"""A query as the daemon's services see it: what was asked, and a reply that holds up nobody.

Zenoh lets whoever replies wait for a peer that does not read, whatever the reply's congestion
control says: it takes that of the query, and so does the end of the query (measured with 1.10.2).
So replies, and ends of queries, go out from threads that have nothing else to do.
"""

# pyright: strict, reportUnknownMemberType=false
# (zenoh's stubs leave out some return types.)

import logging
import threading
from concurrent.futures import ThreadPoolExecutor

import zenoh

log = logging.getLogger(__name__)

MOST_UNSENT = 1024
"""Replies that wait for one of the threads; then who asks holds up the service after all. A name's
sessions reach that only by reading nothing, and are shown out before (session_guard)."""


class Replies:
    """Threads that send, made as they are needed. Closed with `close`."""

    def __init__(self, name: str, most_threads: int) -> None:
        self._pool = ThreadPoolExecutor(most_threads, thread_name_prefix=f"reply {name}")
        self._room = threading.BoundedSemaphore(MOST_UNSENT)

    def send(self, query: zenoh.Query, reply: bytes | None) -> None:
        """Reply and end the query, or only end it; returns at once."""
        if not self._room.acquire(blocking=False):
            query.drop()
            return
        self._pool.submit(self._send, query, reply)

    def close(self) -> None:
        """Send nothing any more."""
        self._pool.shutdown(wait=False, cancel_futures=True)

    def _send(self, query: zenoh.Query, reply: bytes | None) -> None:
        try:
            with query:
                if reply is not None:
                    query.reply(query.key_expr, reply, encoding=zenoh.Encoding.APPLICATION_PROTOBUF)
        except Exception as error:  # Zenoh raises its own and others; the peer may just have gone
            log.debug("a reply on did not go out: %s", error)
        finally:
            self._room.release()


class Request:
    """A query that waits for its reply.

    Attributes:
        payload: what was asked, as bytes.

    """

    def __init__(self, query: zenoh.Query, replies: Replies) -> None:
        self._query = query
        self._replies = replies
        payload = query.payload
        self.payload = b"" if payload is None else payload.to_bytes()

    def answer(self, reply: bytes | None) -> None:
        """The one reply, or none; it goes out by itself."""
        self._replies.send(self._query, reply)
