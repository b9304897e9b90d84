"""The daemon's Zenoh session: explicit endpoints, nothing found by multicast."""

# pyright: strict, reportUnknownMemberType=false
# (zenoh's stubs leave out some return types.)

import logging
import re
import threading
import time
from collections.abc import Callable, Mapping
from typing import Self

import zenoh

from mbot_agent.configuration import Configuration
from mbot_agent.network.doorkeeper import Visitor
from mbot_agent.network.listening import obstacle
from mbot_agent.network.requests import Replies, Request
from mbot_agent.network.zenoh_settings import zenoh_configuration
from mbot_protocol.errors import UnreachableError
from mbot_protocol.wire.keys import ALIVE, DOORS, PRESENCE, ROOT, Topic

log = logging.getLogger(__name__)

MOST_WAITING = 16
"""Queries waiting on one key; more are dropped, oldest first, and get no reply."""

REPLY_THREADS = 4
"""Of each key. A peer that does not read holds one for 200 ms (zenoh_settings)."""

Answer = Callable[[bytes], bytes]
"""Takes a query's payload, returns the reply's. Must not raise."""


class Link:
    """An open session for one robot. A context manager; undeclares everything at its end."""

    def __init__(self, configuration: Configuration) -> None:
        self._robot_id = configuration.robot_id
        self._configuration = configuration
        self._session: zenoh.Session | None = None
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._replies: list[Replies] = []
        self._served: list[Listener] = []
        self._tokens: list[zenoh.LivelinessToken] = []

    def __enter__(self) -> Self:
        """Open the session.

        Raises:
            ConfigurationError: a file of [network.tls] is missing or wrong.
            UnreachableError: an endpoint cannot be used.

        """
        network = self._configuration.network
        if network.tls is not None:
            from mbot_agent.network.tls_files import check_certificates

            if advice := check_certificates(network.tls, self._robot_id).advice:
                log.warning("%s", advice)
        zenoh.init_log_from_env_or("off")
        try:
            self._session = zenoh.open(zenoh_configuration(self._configuration))
        except zenoh.ZError as error:
            found = [there.reason for there in map(obstacle, network.listen) if there is not None]
            raise UnreachableError(
                f"cannot listen on {', '.join(network.listen)}: "
                f"{'; '.join(found) or _reason(error)} (network.listen)"
            ) from None
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        if self._session is not None:
            self._session.close()
        for replies in self._replies:
            replies.close()

    def announce(self) -> None:
        """Show that this robot is alive, and to each who may do what, until the session ends."""
        liveliness = self._open_session.liveliness()
        self._tokens = [
            liveliness.declare_token(topic.key(self._robot_id))
            for topic in (*DOORS.values(), ALIVE)
        ]

    def sees_workstations(self, timeout_s: float) -> bool:
        """Whether any workstation is connected now, directly or by a router."""
        replies = self._open_session.liveliness().get(
            PRESENCE.key(self._robot_id), timeout=timeout_s
        )
        # All replies, not just the first: a query that is dropped half-way is warned about.
        return any([reply.ok is not None for reply in replies])

    def answers(self, name: str, timeout_s: float) -> bool:
        """Whether a service of our own replies on this key below the robot's prefix."""
        replies = self._open_session.get(f"{ROOT}/{self._robot_id}/{name}", timeout=timeout_s)
        return any([reply.ok is not None for reply in replies])

    def visitors(self) -> list[Visitor]:
        """All links there are now."""
        found: list[Visitor] = []
        for link in self._open_session.info.links():
            host, _, port = link.dst.partition("/")[2].partition("?")[0].rpartition(":")
            if port.isdecimal():
                name = link.auth_identifier
                found.append(
                    Visitor(name, (host.strip("[]").partition("%")[0], int(port)), str(link.zid))
                )
        return found

    def watch_visitors(self, hear: Callable[[], None]) -> None:
        """Call `hear` whenever a link opens or closes, on a thread of its own."""
        listener = self._open_session.info.declare_link_events_listener(
            zenoh.handlers.RingChannel(MOST_WAITING)
        )

        def run() -> None:
            for _ in listener:
                hear()

        threading.Thread(target=run, name="visitors", daemon=True).start()

    def publish(self, topic: Topic, payload: bytes) -> None:
        """Send to whoever listens; dropped if the link is slow (BLOCK held a put for 5 s)."""
        self._publisher(topic).put(payload)

    def is_watched(self, topic: Topic) -> bool:
        """Whether anybody listens to it now."""
        # The stubs call it a bool; it is an object that is always true.
        status = self._publisher(topic).matching_status
        return status.matching  # pyright: ignore[reportAttributeAccessIssue, reportUnknownVariableType]

    def _publisher(self, topic: Topic) -> zenoh.Publisher:
        publisher = self._publishers.get(topic.name)
        if publisher is None:
            publisher = self._open_session.declare_publisher(
                topic.key(self._robot_id),
                encoding=zenoh.Encoding.APPLICATION_PROTOBUF.with_schema(topic.message),
                congestion_control=zenoh.CongestionControl.DROP,
                reliability=zenoh.Reliability.BEST_EFFORT,
            )
            self._publishers[topic.name] = publisher
        return publisher

    def serve(self, answers: Mapping[str, Answer]) -> "list[Listener]":
        """Answer queries on these keys, one after another: their answers take turns.

        Args:
            answers: by topic name.

        """
        turn = threading.Lock()

        def in_turn(answer: Answer) -> Callable[[Request], None]:
            def take(request: Request) -> None:
                with turn:
                    reply = answer(request.payload)
                request.answer(reply)

            return take

        return [self.listen(name, in_turn(answer)) for name, answer in answers.items()]

    def listen(
        self,
        name: str,
        take: Callable[[Request], None],
        *,
        most_waiting: int = MOST_WAITING,
        reply_threads: int = REPLY_THREADS,
    ) -> "Listener":
        """Hand over each query on one key, on a thread of its own.

        The key is declared as it is: a router passes on what somebody has declared, and its rules
        let a robot declare the keys of the table and no wildcard.

        Args:
            name: of the topic.
            take: is handed each query; what it raises leaves that one unanswered.
            most_waiting: queries that have come and were not handed over; older ones are dropped.
            reply_threads: how many replies may be held up by those who do not read them.

        """
        key = f"{ROOT}/{self._robot_id}/{name}"
        # A ring, not a FIFO: a full FIFO would hold up Zenoh's own thread, and a STOP with it.
        queryable = self._open_session.declare_queryable(
            key, zenoh.handlers.RingChannel(most_waiting)
        )
        replies = Replies(name, reply_threads)
        self._replies.append(replies)
        listener = Listener(queryable, key, take, replies)
        self._served.append(listener)
        return listener

    @property
    def queries(self) -> int:
        """How many have come in so far, on all keys."""
        return sum(listener.taken for listener in self._served)

    @property
    def _open_session(self) -> zenoh.Session:
        if self._session is None:
            raise UnreachableError("the link is not open")
        return self._session


class Listener:
    """The thread of one key.

    Attributes:
        taken: queries so far.

    """

    def __init__(
        self,
        queryable: zenoh.Queryable[zenoh.handlers.Handler[zenoh.Query]],
        key: str,
        take: Callable[[Request], None],
        replies: Replies,
    ) -> None:
        self._queryable = queryable
        self._key = key
        self._take = take
        self._replies = replies
        self._taking_since_ns: int | None = None
        self.taken = 0
        name = f"serve {key.split('/', 2)[2]}"
        threading.Thread(target=self._run, name=name, daemon=True).start()

    @property
    def progress_ns(self) -> int:
        """When the thread was last seen to work, monotonic: now, unless it is at something."""
        since_ns = self._taking_since_ns
        return time.monotonic_ns() if since_ns is None else since_ns

    def _run(self) -> None:
        for query in self._queryable:
            request = Request(query, self._replies)
            self.taken += 1
            if str(query.key_expr) != self._key:  # whoever asks by a wildcard asks nobody
                request.answer(None)
                continue
            self._taking_since_ns = time.monotonic_ns()
            try:
                self._take(request)
            except Exception:
                # Whatever goes wrong, the thread must live on to serve the next.
                log.exception("a query on %s went unanswered", self._key)
                request.answer(None)
            self._taking_since_ns = None


def _reason(error: Exception) -> str:
    """Zenoh's words up to where its own source positions begin; of nested ones the innermost."""
    words = str(error).split(" at /")[0].splitlines()[0]
    inner = re.search(r"([A-Z][^\[\]:]*) \(os error \d+\)", words)
    return inner[1] if inner else words[:160]
