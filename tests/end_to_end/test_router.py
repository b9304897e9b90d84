"""A fleet behind a Zenoh router, with the configuration that `workstation enroll --router` makes.

The router is Zenoh's own, as zenohd runs it: a session in the mode "router".
"""

import re
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
import zenoh

from mbot_protocol.errors import RefusedError
from mbot_protocol.v1.messages_pb2 import Command, CommandReply
from mbot_protocol.wire.keys import (
    ALIVE,
    COMMAND,
    DECISION,
    MODELS,
    STATUS,
    STOP,
    TOPICS,
    Flow,
    Right,
    Topic,
)
from mbot_workstation.fleet.link.address import Endpoint
from mbot_workstation.fleet.link.rights import rights_at
from mbot_workstation.fleet.link.robot_session import alive_robots, open_session

from ..free_port import free_port
from .fleet import LOCALHOST, Fleet, TalkingRobot
from .processes import until

QUERIES = [topic for topic in TOPICS if topic.flow is Flow.QUERY]
ROBOTS = {
    "mbot-1": {"vera": [Right.VIEW], "dora": [Right.DRIVE], "paul": [Right.PUSH]},
    "mbot-2": {"nick": [Right.PUSH, Right.DRIVE]},
}


def router(fleet: Fleet, name: str) -> zenoh.Session:
    return zenoh.open(zenoh.Config.from_json5(fleet.router_settings(name)))


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Fleet:
    fleet = Fleet(tmp_path_factory.mktemp("fleet"))
    fleet.enrolment.router("lab", [LOCALHOST], free_port())
    for robot_id, people in ROBOTS.items():
        fleet.enrol(robot_id, people, router="lab")
    return fleet


@pytest.fixture(scope="module")
def robots(fleet: Fleet) -> Iterator[dict[str, TalkingRobot]]:
    """Both robots, behind the router, which is switched on after them."""
    with ExitStack() as stack:
        found = {
            name: stack.enter_context(TalkingRobot(fleet.configuration(name))) for name in ROBOTS
        }
        stack.enter_context(router(fleet, "lab"))
        with (
            open_session(by_router(fleet), fleet.security("vera")) as first,
            open_session(by_router(fleet), fleet.security("nick")) as second,
        ):
            assert until(lambda: alive_robots(first, 1.0) == ["mbot-1"], 20)
            assert until(lambda: alive_robots(second, 1.0) == ["mbot-2"], 20)
        yield found


def by_router(fleet: Fleet) -> Endpoint:
    return fleet.folder.roll().endpoint("mbot-1")


def ask(session: zenoh.Session, topic: Topic, robot_id: str) -> list[bytes]:
    replies = session.get(topic.key(robot_id), payload=b"x", timeout=2.0)
    return [reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None]


@pytest.mark.parametrize("name", ["vera", "dora", "paul", "nick"])
@pytest.mark.usefixtures("robots")
def test_everybody_reaches_just_what_the_rights_open(fleet: Fleet, name: str) -> None:
    with open_session(by_router(fleet), fleet.security(name)) as session:
        seen: list[str] = []
        for robot_id, people in ROBOTS.items():
            rights = {Right.VIEW, *people[name]} if name in people else set[Right]()
            for topic in QUERIES:
                answers = [f"{robot_id} {topic.name}".encode()] if topic.right in rights else []
                assert ask(session, topic, robot_id) == answers, (robot_id, topic.name)
            assert rights_at(session, robot_id, 2.0) == rights
            seen += [robot_id] if rights else []
        assert alive_robots(session, 2.0) == seen


def test_telemetry_comes_through_to_those_who_may_look(
    fleet: Fleet, robots: dict[str, TalkingRobot]
) -> None:
    with (
        open_session(by_router(fleet), fleet.security("vera")) as session,
        session.declare_subscriber("mbot/**", zenoh.handlers.RingChannel(8)) as everything,
        session.declare_subscriber(DECISION.key("mbot-1"), zenoh.handlers.RingChannel(8)) as one,
    ):

        def heard() -> bool:
            for robot in robots.values():
                robot.say()
            return one.try_recv() is not None

        assert until(heard)
        keys = {str(s.key_expr) for s in iter(everything.try_recv, None) if s is not None}
        assert keys <= {DECISION.key("mbot-1")}


@pytest.mark.parametrize("robot_id", list(ROBOTS))
def test_a_robot_behind_it_reaches_no_other(
    fleet: Fleet, robots: dict[str, TalkingRobot], robot_id: str
) -> None:
    """Somebody with the robot's card in his pocket: its own keys and nothing else."""
    [other] = set(ROBOTS) - {robot_id}
    robots[other].asked.clear()
    watcher = next(iter(ROBOTS[other]))
    with (
        open_session(by_router(fleet), fleet.security_of_robot(robot_id)) as taken,
        open_session(by_router(fleet), fleet.security(watcher)) as session,
        session.declare_subscriber(DECISION.key(other), zenoh.handlers.RingChannel(8)) as samples,
        taken.declare_subscriber("mbot/**", zenoh.handlers.RingChannel(8)) as spy,
    ):
        assert [ask(taken, topic, other) for topic in QUERIES] == [[]] * len(QUERIES)
        assert robots[other].asked == []
        # From here on it also claims to be the other robot.
        token = taken.liveliness().declare_token(ALIVE.key("mbot-9"))
        false = taken.declare_queryable(STATUS.key(other), zenoh.handlers.RingChannel(8))
        assert ask(session, STATUS, other) == [f"{other} status".encode()]
        assert false.try_recv() is None
        assert alive_robots(session, 1.0) == [other]
        heard: list[bytes] = []

        def hear() -> bool:
            taken.put(DECISION.key(other), b"false")
            robots[other].say()
            heard.extend(
                s.payload.to_bytes() for s in iter(samples.try_recv, None) if s is not None
            )
            return len(heard) > 3

        assert until(hear)
        assert set(heard) == {f"{other} decides".encode()}
        # It hears what it says itself to its own session, but never the other robot.
        said = {s.payload.to_bytes() for s in iter(spy.try_recv, None) if s is not None}
        assert said <= {b"false"}
        token.undeclare()


@pytest.mark.usefixtures("robots")
def test_a_denial_by_the_router_names_person_and_right(fleet: Fleet) -> None:
    words = re.escape("vera has no right to drive mbot-1 (only: view)")
    with fleet.link("mbot-1", "vera") as link:
        assert b"mbot-1 stop" in ask(link._session, STOP, "mbot-1")  # pyright: ignore
        with pytest.raises(RefusedError, match=words):
            link.query(COMMAND, Command(schema_version=1), CommandReply, 1.0)
    with fleet.link("mbot-1", "dora") as link, pytest.raises(RefusedError, match="dora has no"):
        link.query(MODELS, None, CommandReply, 1.0)


def test_a_robot_sees_its_workstations_through_the_router(
    fleet: Fleet, robots: dict[str, TalkingRobot]
) -> None:
    assert until(lambda: not robots["mbot-1"].link.sees_workstations(1.0))
    with fleet.link("mbot-1", "vera"):
        assert until(lambda: robots["mbot-1"].link.sees_workstations(1.0))
        assert not robots["mbot-2"].link.sees_workstations(1.0)
    assert until(lambda: not robots["mbot-1"].link.sees_workstations(1.0))


def test_a_router_that_a_robot_does_not_know_gets_nothing(tmp_path: Path) -> None:
    """It is of the fleet, has the address that the robot connects to, and another name."""
    fleet = Fleet(tmp_path / "fleet")
    port = free_port()
    fleet.enrolment.router("lab", [LOCALHOST], port)
    fleet.enrol("mbot-1", {"dora": [Right.DRIVE]}, router="lab")
    configuration = fleet.configuration("mbot-1")
    endpoint = by_router(fleet)
    fleet.enrol("mbot-1", router="")
    fleet.enrolment.revoke("lab")
    fleet.enrolment.router("hall", [LOCALHOST], port)
    fleet.enrol("mbot-1", router="hall")
    with (
        router(fleet, "hall") as hall,
        TalkingRobot(configuration) as robot,
        open_session(endpoint, fleet.security("dora")) as session,
    ):
        assert until(lambda: len(list(hall.info.peers_zid())) == 1)
        assert [ask(session, topic, "mbot-1") for topic in QUERIES] == [[]] * len(QUERIES)
        assert alive_robots(session, 1.0) == []
        assert robot.asked == []


def test_a_router_without_robots_lets_nothing_through(tmp_path: Path) -> None:
    fleet = Fleet(tmp_path / "fleet")
    fleet.enrolment.router("lab", [LOCALHOST], free_port())
    me = fleet.security(fleet.folder.roll().me)
    endpoint = fleet.folder.roll().routers["lab"].endpoint
    with (
        router(fleet, "lab"),
        open_session(endpoint, me) as one,
        open_session(endpoint, me) as two,
        one.declare_queryable("a/b", zenoh.handlers.RingChannel(8)) as queries,
    ):
        assert list(two.get("a/b", timeout=1.0)) == []
        assert queries.try_recv() is None
