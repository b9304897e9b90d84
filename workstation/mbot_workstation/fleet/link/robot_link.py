"""The workstation's end of the link to one robot: queries with decoded replies, subscriptions."""

import getpass
import os
import time
from contextlib import ExitStack
from typing import Self, TypeVar

import zenoh
from google.protobuf.message import Message

from mbot_protocol.errors import MbotError, RefusedError, UnreachableError
from mbot_protocol.v1.messages_pb2 import Status
from mbot_protocol.wire.keys import (
    ALIVE,
    COMMAND,
    PUSH_CHUNK,
    RECORDING_READ,
    RELEASE_CHUNK,
    STATUS,
    STOP,
    Topic,
    check_robot_id,
    presence_key,
)
from mbot_protocol.wire.schema import decode
from mbot_workstation.fleet.link.address import ADDRESS_VARIABLE, Endpoint, parse_address
from mbot_workstation.fleet.link.rights import person, refusal, rights_at
from mbot_workstation.fleet.link.robot_session import alive_robots, open_session
from mbot_workstation.fleet.link.security import LinkSecurity
from mbot_workstation.wording import one_line

M = TypeVar("M", bound=Message)

QUERY_TIMEOUT_S = 2.0

REACH_TIMEOUT_S = 2.0
REACH_PAUSE_S = 0.005

# A command overtakes a push that goes on beside it; a push or a fetch leaves the link to all else.
_PRIORITIES = {
    STOP.name: zenoh.Priority.REAL_TIME,
    COMMAND.name: zenoh.Priority.INTERACTIVE_HIGH,
    PUSH_CHUNK.name: zenoh.Priority.DATA_LOW,
    RELEASE_CHUNK.name: zenoh.Priority.DATA_LOW,
    RECORDING_READ.name: zenoh.Priority.DATA_LOW,
}


class RobotLink:
    """A session with one robot; a context manager.

    The connection heals by itself: after a restart of the robot's daemon queries work again and
    subscriptions go on.

    Attributes:
        endpoint: where it connects to.
        robot_id: the robot it talks to; known once entered.

    """

    def __init__(
        self,
        address: str | None = None,
        robot_id: str | None = None,
        security: LinkSecurity | None = None,
    ) -> None:
        """Prepare a link; nothing is opened yet.

        Args:
            address: as `parse_address` takes it; None: $MBOT_ROBOT, or this machine.
            robot_id: which robot; None: the only one that is alive there.
            security: certificates for a `tls/` address.

        Raises:
            ConfigurationError: the address or the identifier is unusable.

        """
        text = os.environ.get(ADDRESS_VARIABLE, "") if address is None else address
        self.endpoint: Endpoint = parse_address(text, secured=security is not None)
        self._wanted_id = None if robot_id is None else check_robot_id(robot_id)
        self._security = security
        self._stack = ExitStack()
        self._session: zenoh.Session | None = None
        self._robot_id = ""
        self._token: zenoh.LivelinessToken | None = None

    @property
    def robot_id(self) -> str:
        """The robot's identifier; the link must be open."""
        self._open_session()
        return self._robot_id

    @property
    def sender(self) -> str:
        """Who sends what goes over this link, for people to read: no proof of anything."""
        return person(self._security) or getpass.getuser()

    def __enter__(self) -> Self:
        """Connect and find the robot.

        Raises:
            UnreachableError: nobody answers, no robot is alive there, or several are.

        """
        with ExitStack() as stack:
            self._session = stack.enter_context(open_session(self.endpoint, self._security))
            # With --id the search is left out: a STOP must not wait for it.
            self._robot_id = self._wanted_id or self._only_robot(self._session)
            # A robot may have been told not to drive while nobody is there.
            key = presence_key(self._robot_id, str(self._session.zid()))
            self._token = self._session.liveliness().declare_token(key)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._session = None
        self._stack.close()

    def query(
        self,
        topic: Topic,
        request: Message | None,
        reply_type: type[M],
        timeout_s: float = QUERY_TIMEOUT_S,
    ) -> M:
        """Ask the robot and wait for its one reply.

        Raises:
            UnreachableError: no reply; the request may or may not have been carried out.
            RefusedError: this workstation has not the right to ask that, or the daemon answered
                with an error instead of a reply.
            NewerSchemaError, MalformedMessageError: the reply can't be read.

        """
        session = self._open_session()
        payload = None if request is None else request.SerializeToString()
        try:
            replies = session.get(
                topic.key(self._robot_id),
                payload=payload,
                encoding=None if payload is None else _encoding(topic.message),
                priority=_PRIORITIES.get(topic.name, zenoh.Priority.DATA),
                express=topic in (STOP, COMMAND),
                timeout=timeout_s,
            )
            for reply in replies:
                if reply.ok is not None:
                    data = reply.ok.payload.to_bytes()
                    return decode(reply_type, data, f"robot {self._robot_id}")
                if reply.err is not None and not _is_timeout(reply.err):
                    reason = one_line(reply.err.payload.to_bytes().decode(errors="replace"))
                    raise RefusedError(f"robot {self._robot_id} refused {topic.name}: {reason}")
        except zenoh.ZError as error:
            raise UnreachableError(
                f"the link to {self.endpoint} broke: {one_line(str(error))}"
            ) from None
        raise self._why_silent(topic, timeout_s)

    def reaches(self, topic: Topic, timeout_s: float = REACH_TIMEOUT_S) -> bool:
        """Whether a query on this key would come to the robot.

        A router passes on only what the robot behind it has declared and the rules let through; a
        robot that is connected to directly hears everything that it serves.
        """
        session = self._open_session()
        if not session.info.routers_zid():
            return True
        with session.declare_querier(topic.key(self._robot_id)) as querier:
            until_s = time.monotonic() + timeout_s
            # What the router knows comes a round trip after it was asked for.
            # The stubs call it a bool; it is an object that is always true.
            while not querier.matching_status.matching:  # pyright: ignore[reportAttributeAccessIssue]
                if time.monotonic() > until_s:
                    return False
                time.sleep(REACH_PAUSE_S)
        return True

    def status(self, timeout_s: float = QUERY_TIMEOUT_S) -> Status:
        """The robot's state now; raises as `query` does."""
        return self.query(STATUS, None, Status, timeout_s)

    def subscribe(
        self, topic: Topic, depth: int
    ) -> "zenoh.Subscriber[zenoh.handlers.Handler[zenoh.Sample]]":
        """The newest `depth` samples of a topic; older ones give way, so nobody ever blocks.

        No Python callbacks: with one open, an uncaught exception hangs the process
        (zenoh-python#434).
        """
        key = topic.key(self._robot_id)
        return self._open_session().declare_subscriber(key, zenoh.handlers.RingChannel(depth))

    def watch_alive(self) -> "zenoh.Subscriber[zenoh.handlers.Handler[zenoh.Sample]]":
        """PUT when the robot's daemon appears, or is there already; DELETE when it goes."""
        liveliness = self._open_session().liveliness()
        return liveliness.declare_subscriber(
            ALIVE.key(self._robot_id), zenoh.handlers.RingChannel(8), history=True
        )

    def _open_session(self) -> zenoh.Session:
        if self._session is None:
            raise RuntimeError("the link is not open: use it in a `with` statement")
        return self._session

    def _only_robot(self, session: zenoh.Session) -> str:
        robots = alive_robots(session)
        if not robots:
            raise UnreachableError(f"no robot is alive at {self.endpoint}{self._or_not_allowed()}")
        if len(robots) > 1:
            raise UnreachableError(
                f"{len(robots)} robots are alive at {self.endpoint}: {', '.join(robots)}; "
                f"choose one, such as --id {robots[0]}"
            )
        return robots[0]

    def _or_not_allowed(self) -> str:
        if not (who := person(self._security)):
            return "; if it is a router, is mbot-agent connected to it?"
        return (
            f", or {who} may not see it; is {who} among its people, the newest enrolment copied to "
            "it, and mbot-agent running?"
        )

    def refused(self, topic: Topic) -> RefusedError | None:
        """The error for what this workstation may not ask of the robot; None if it may."""
        rights = rights_at(self._open_session(), self._robot_id, timeout_s=1.0)
        if not rights or topic.right in rights:
            return None
        return refusal(person(self._security), self._robot_id, topic.right, rights)

    def _why_silent(self, topic: Topic, timeout_s: float) -> MbotError:
        """The error for a query without a reply; a forbidden one looks just like that."""
        session, robot_id = self._open_session(), self._robot_id
        robots = alive_robots(session, timeout_s=1.0)
        start = f"robot {robot_id} at {self.endpoint} gave no reply to {topic.name}"
        if robot_id in robots:
            if (refused := self.refused(topic)) is not None:
                return refused
            return UnreachableError(
                f"{start} within {timeout_s:g} s although it is alive; is the link slow or the "
                "robot overloaded?"
            )
        if robots:
            return UnreachableError(f"{start}; alive there: {', '.join(robots)}")
        if person(self._security):
            return UnreachableError(f"{start}; no robot is alive there{self._or_not_allowed()}")
        return UnreachableError(
            f"{start}; no robot is alive there; is mbot-agent running (`systemctl status "
            "mbot-agent`)?"
        )


def _encoding(message_name: str) -> zenoh.Encoding:
    return zenoh.Encoding.APPLICATION_PROTOBUF.with_schema(message_name)


def _is_timeout(error: zenoh.ReplyError) -> bool:
    # Zenoh itself answers a query whose time is up with an error reply of this text.
    return error.payload.to_bytes() == b"Timeout"
