"""The daemon's Zenoh session: explicit endpoints, nothing found by multicast."""

# pyright: strict, reportUnknownMemberType=false
# (zenoh's stubs leave out some return types.)

import json
import logging
import threading
from collections.abc import Callable, Mapping
from types import TracebackType
from typing import Self

import zenoh

from mbot_agent.configuration import Configuration, Network
from mbot_protocol.errors import UnreachableError
from mbot_protocol.keys import ALIVE, ROOT, Topic

log = logging.getLogger(__name__)

LARGEST_MESSAGE_BYTES = 1 << 20
"""The largest message anybody needs is a 64 KiB chunk of a model."""

MOST_SESSIONS = 16

LEASE_MS = 2000
"""A workstation that fell silent is forgotten after this; Zenoh's own default is 10 s."""

MOST_WAITING = 16
"""Queries waiting for one service; more are dropped, oldest first, and get no reply."""

Answer = Callable[[bytes], bytes]
"""Takes a query's payload, returns the reply's. Must not raise."""


class Link:
    """An open session for one robot. A context manager; undeclares everything at its end."""

    def __init__(self, configuration: Configuration) -> None:
        self._robot_id = configuration.robot_id
        self._network = configuration.network
        self._session: zenoh.Session | None = None
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._queryables: list[zenoh.Queryable[zenoh.handlers.Handler[zenoh.Query]]] = []
        self._token: zenoh.LivelinessToken | None = None

    def __enter__(self) -> Self:
        zenoh.init_log_from_env_or("off")
        try:
            self._session = zenoh.open(zenoh_configuration(self._network))
        except zenoh.ZError as error:
            endpoints = ", ".join((*self._network.listen, *self._network.connect))
            raise UnreachableError(
                f"cannot listen on {endpoints}: {_reason(error)}; is another mbot-agent running, "
                "or a certificate file unreadable? (network.listen)"
            ) from None
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._session is not None:
            self._session.close()

    def announce(self) -> None:
        """Show that this robot is alive, until the session ends."""
        self._token = self._open_session.liveliness().declare_token(ALIVE.key(self._robot_id))

    def publish(self, topic: Topic, payload: bytes) -> None:
        """Send to whoever listens; dropped if the link is slow (BLOCK held a put for 5 s)."""
        publisher = self._publishers.get(topic.name)
        if publisher is None:
            publisher = self._open_session.declare_publisher(
                topic.key(self._robot_id),
                encoding=zenoh.Encoding.APPLICATION_PROTOBUF.with_schema(topic.message),
                congestion_control=zenoh.CongestionControl.DROP,
                reliability=zenoh.Reliability.BEST_EFFORT,
            )
            self._publishers[topic.name] = publisher
        publisher.put(payload)

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
    """Zenoh's words up to where its own source positions begin."""
    return str(error).split(" at /")[0].splitlines()[0][:160]


def zenoh_configuration(network: Network) -> zenoh.Config:
    """Zenoh's configuration for this network: no scouting, bounded messages and sessions."""
    config = zenoh.Config()
    settings: dict[str, object] = {
        "mode": "peer",
        "listen/endpoints": list(network.listen),
        "connect/endpoints": list(network.connect),
        "listen/exit_on_failure": True,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/unicast/max_sessions": MOST_SESSIONS,
        "transport/link/rx/max_message_size": LARGEST_MESSAGE_BYTES,
        "transport/link/tx/lease": LEASE_MS,
        "transport/link/protocols": ["tcp"] if network.tls is None else ["tcp", "tls"],
        "transport/shared_memory/enabled": False,
    }
    if network.tls is not None:
        settings |= {
            "transport/link/tls/root_ca_certificate": network.tls.ca,
            "transport/link/tls/listen_certificate": network.tls.certificate,
            "transport/link/tls/listen_private_key": network.tls.key,
            "transport/link/tls/connect_certificate": network.tls.certificate,
            "transport/link/tls/connect_private_key": network.tls.key,
            "transport/link/tls/enable_mtls": True,
            "transport/link/tls/close_link_on_expiration": True,
        }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config
