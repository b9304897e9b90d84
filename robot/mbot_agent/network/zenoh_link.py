"""The daemon's Zenoh session: explicit endpoints, nothing found by multicast."""

# pyright: strict, reportUnknownMemberType=false
# (zenoh's stubs leave out some return types.)

import logging
import re
import threading
from collections.abc import Callable, Mapping
from typing import Self

import zenoh

from mbot_agent.configuration import Configuration
from mbot_agent.network.listening import obstacle
from mbot_agent.network.session_guard import Visitor
from mbot_agent.network.zenoh_settings import zenoh_configuration
from mbot_protocol.errors import UnreachableError
from mbot_protocol.keys import ALIVE, DOORS, PRESENCE, ROOT, Topic

log = logging.getLogger(__name__)

MOST_WAITING = 16
"""Queries waiting for one service; more are dropped, oldest first, and get no reply."""

Answer = Callable[[bytes], bytes]
"""Takes a query's payload, returns the reply's. Must not raise."""


class Link:
    """An open session for one robot. A context manager; undeclares everything at its end."""

    def __init__(self, configuration: Configuration) -> None:
        self._robot_id = configuration.robot_id
        self._configuration = configuration
        self._session: zenoh.Session | None = None
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._queryables: list[zenoh.Queryable[zenoh.handlers.Handler[zenoh.Query]]] = []
        self._tokens: list[zenoh.LivelinessToken] = []
        self._listeners: list[zenoh.LinkEventsListener[zenoh.handlers.Handler[zenoh.LinkEvent]]]
        self._listeners = []

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
                found.append(Visitor(name, (host.strip("[]"), int(port)), str(link.zid)))
        return found

    def watch_visitors(self, hear: Callable[[], None]) -> None:
        """Call `hear` whenever a link opens or closes, on a thread of its own."""
        listener = self._open_session.info.declare_link_events_listener(
            zenoh.handlers.RingChannel(MOST_WAITING)
        )

        def run() -> None:
            for _ in listener:
                hear()

        self._listeners.append(listener)
        threading.Thread(target=run, name="visitors", daemon=True).start()

    def publish(self, topic: Topic, payload: bytes) -> None:
        """Send to whoever listens; dropped if the link is slow (BLOCK held a put for 5 s)."""
        self._publisher(topic).put(payload)

    def is_watched(self, topic: Topic) -> bool:
        """Whether anybody listens to it now."""
        return self._publisher(topic).matching_status

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

    def serve(self, below: str, answers: Mapping[str, Answer]) -> None:
        """Answer queries on some keys, one after another, on a thread of their own.

        Args:
            below: the keys' common part below the robot's prefix; may end in `/**`.
            answers: by topic name. A query that names none of them exactly gets no reply.

        """
        prefix = f"{ROOT}/{self._robot_id}/"
        # A ring, not a FIFO: a full FIFO would hold up Zenoh's own thread, and a STOP with it.
        queryable = self._open_session.declare_queryable(
            prefix + below, zenoh.handlers.RingChannel(MOST_WAITING)
        )

        def run() -> None:
            for query in queryable:
                with query:
                    _answer(query, answers.get(str(query.key_expr).removeprefix(prefix)))

        self._queryables.append(queryable)
        threading.Thread(target=run, name=f"serve {below}", daemon=True).start()

    @property
    def _open_session(self) -> zenoh.Session:
        if self._session is None:
            raise UnreachableError("the link is not open")
        return self._session


def _answer(query: zenoh.Query, answer: Answer | None) -> None:
    """Reply to one query. Whatever goes wrong, the thread must live on to serve the next."""
    if answer is None:
        return
    try:
        payload = query.payload
        reply = answer(b"" if payload is None else payload.to_bytes())
        query.reply(query.key_expr, reply, encoding=zenoh.Encoding.APPLICATION_PROTOBUF)
    except Exception:
        log.exception("a query on %s went unanswered", query.key_expr)


def _reason(error: Exception) -> str:
    """Zenoh's words up to where its own source positions begin; of nested ones the innermost."""
    words = str(error).split(" at /")[0].splitlines()[0]
    inner = re.search(r"([A-Z][^\[\]:]*) \(os error \d+\)", words)
    return inner[1] if inner else words[:160]
