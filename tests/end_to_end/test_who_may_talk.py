"""Rights over real Zenoh sessions with mutual TLS: what is allowed works, all else is silent."""

import re
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh

from mbot_agent.network.zenoh_settings import zenoh_configuration
from mbot_protocol.errors import MbotError, RefusedError, UnreachableError
from mbot_protocol.v1.messages_pb2 import Command, CommandReply
from mbot_protocol.wire.access_rules import Kind
from mbot_protocol.wire.keys import (
    ACTIVATE,
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
from mbot_workstation.fleet.enrolment.certificates import issue, make_authority
from mbot_workstation.fleet.link.address import Endpoint
from mbot_workstation.fleet.link.diagnosis import why_no_session
from mbot_workstation.fleet.link.rights import person, rights_at
from mbot_workstation.fleet.link.robot_link import RobotLink
from mbot_workstation.fleet.link.robot_session import alive_robots, open_session
from mbot_workstation.fleet.link.security import LinkSecurity

from .fleet import LOCALHOST, Fleet, TalkingRobot
from .processes import until

QUERIES = [topic for topic in TOPICS if topic.flow is Flow.QUERY]
PEOPLE = {
    "vera": [Right.VIEW],
    "paul": [Right.PUSH],
    "dora": [Right.DRIVE],
    "alma": [Right.PUSH, Right.DRIVE],
}
NOBODY = "nick"


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Fleet:
    """Two robots; nick has rights on the second one only."""
    fleet = Fleet(tmp_path_factory.mktemp("fleet"))
    fleet.enrol("mbot-1", PEOPLE)
    fleet.enrol("mbot-2", {NOBODY: [Right.PUSH, Right.DRIVE]})
    return fleet


@pytest.fixture(scope="module")
def robot(fleet: Fleet) -> Iterator[TalkingRobot]:
    with TalkingRobot(fleet.configuration("mbot-1")) as robot:
        yield robot


def endpoint(fleet: Fleet, robot_id: str = "mbot-1") -> Endpoint:
    return fleet.folder.roll().endpoint(robot_id)


def ask(session: zenoh.Session, topic: Topic, robot_id: str = "mbot-1") -> list[bytes]:
    replies = session.get(topic.key(robot_id), payload=b"x", timeout=2.0)
    return [reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None]


@pytest.mark.parametrize("name", [*PEOPLE, NOBODY])
@pytest.mark.usefixtures("robot")
def test_everybody_reaches_just_what_the_rights_open(fleet: Fleet, name: str) -> None:
    rights = {Right.VIEW, *PEOPLE[name]} if name in PEOPLE else set[Right]()
    with open_session(endpoint(fleet), fleet.security(name)) as session:
        for topic in QUERIES:
            answers = [f"mbot-1 {topic.name}".encode()] if topic.right in rights else []
            assert ask(session, topic) == answers, topic.name
        assert rights_at(session, "mbot-1", 2.0) == rights
        assert alive_robots(session, 2.0) == (["mbot-1"] if rights else [])


@pytest.mark.parametrize(
    ("name", "key", "hears"),
    [
        ("vera", DECISION.key("mbot-1"), True),
        (NOBODY, DECISION.key("mbot-1"), False),
        (NOBODY, "**", False),
    ],
)
def test_telemetry_is_for_those_who_may_look(
    fleet: Fleet, robot: TalkingRobot, name: str, key: str, hears: bool
) -> None:
    with (
        open_session(endpoint(fleet), fleet.security(name)) as session,
        session.declare_subscriber(key, zenoh.handlers.RingChannel(4)) as samples,
    ):

        def heard() -> bool:
            robot.say()
            return payloads(samples) != []

        assert until(heard, 10 if hears else 1) == hears


def payloads(samples: "zenoh.Subscriber[zenoh.handlers.Handler[zenoh.Sample]]") -> list[bytes]:
    """What has come in so far."""
    return [s.payload.to_bytes() for s in iter(samples.try_recv, None) if s is not None]


@pytest.mark.usefixtures("robot")
def test_whoever_may_look_may_stop(fleet: Fleet) -> None:
    with open_session(endpoint(fleet), fleet.security("vera")) as session:
        assert ask(session, STOP) == [b"mbot-1 stop"]
        assert ask(session, COMMAND) == []


@pytest.mark.parametrize(
    ("name", "topic", "words"),
    [
        ("vera", COMMAND, "vera has no right to drive mbot-1 (only: view); ask whoever enrolled"),
        ("dora", MODELS, "dora has no right to send models to mbot-1"),
        ("vera", ACTIVATE, "`workstation enroll mbot-1 --person vera --right push`"),
        (NOBODY, STATUS, "no robot is alive there, or nick may not see it; is nick among its"),
    ],
)
@pytest.mark.usefixtures("robot")
def test_a_denial_names_person_and_right(fleet: Fleet, name: str, topic: Topic, words: str) -> None:
    with (
        RobotLink(str(endpoint(fleet)), "mbot-1", fleet.security(name)) as link,
        pytest.raises(MbotError, match=re.escape(words)) as caught,
    ):
        link.query(topic, Command(schema_version=1), CommandReply, 1.0)
    assert isinstance(caught.value, RefusedError if name in PEOPLE else UnreachableError)


def test_nobody_at_all_is_told_so(fleet: Fleet, robot: TalkingRobot) -> None:
    with (
        pytest.raises(UnreachableError, match="or nick may not see it"),
        RobotLink(str(endpoint(fleet)), None, fleet.security(NOBODY)),
    ):
        pass
    assert robot.robot_id == "mbot-1"


@pytest.mark.usefixtures("robot")
def test_another_robots_certificate_commands_nothing(fleet: Fleet) -> None:
    with open_session(endpoint(fleet), fleet.security_of_robot("mbot-2")) as session:
        assert [ask(session, topic) for topic in QUERIES] == [[]] * len(QUERIES)
        assert alive_robots(session, 1.0) == []


def test_a_workstation_cannot_answer_for_the_robot(fleet: Fleet, robot: TalkingRobot) -> None:
    """Somebody with every right but being the robot: no queryable, sample or token gets through."""
    with (
        open_session(endpoint(fleet), fleet.security("alma")) as false,
        open_session(endpoint(fleet), fleet.security("vera")) as watcher,
    ):
        samples = watcher.declare_subscriber(DECISION.key("mbot-1"), zenoh.handlers.RingChannel(8))
        key = STATUS.key("mbot-1")
        queryable = false.declare_queryable(key, zenoh.handlers.RingChannel(8))
        tokens = [
            false.liveliness().declare_token(ALIVE.key(name)) for name in ("mbot-7", "mbot-1")
        ]
        false.put(DECISION.key("mbot-1"), b"false")
        assert ask(watcher, STATUS) == [b"mbot-1 status"]
        assert queryable.try_recv() is None
        assert alive_robots(watcher, 1.0) == ["mbot-1"]
        heard: list[bytes] = []

        def hear() -> bool:
            robot.say()
            heard.extend(payloads(samples))
            return bool(heard)

        assert until(hear)
        assert set(heard) == {b"mbot-1 decides"}
        assert len(tokens) == 2


def test_another_robot_cannot_pose_as_this_one(fleet: Fleet) -> None:
    """At the address of mbot-1 stands mbot-9, enrolled for another name: it is not accepted."""
    fleet.enrol("mbot-9", host="mbot-9.invalid")
    with TalkingRobot(fleet.configuration("mbot-9")):
        there = Endpoint("tls", LOCALHOST, fleet.ports["mbot-9"])
        words = f"not for {LOCALHOST}; use another of the robot's names"
        assert words in why_no_session(there, fleet.security("vera"), 2.0)
        with pytest.raises(UnreachableError, match="is not for"):
            open_session(there, fleet.security("vera"), 0.5)


def test_a_person_cannot_pose_as_a_robot(fleet: Fleet) -> None:
    """A person's certificate is for calling only, even one that names the host."""
    identity = issue(fleet.folder.authority, Kind.PERSON, "mallory", [LOCALHOST])
    configuration = fleet.configuration("mbot-2")
    assert configuration.network.tls is not None
    Path(configuration.network.tls.certificate).write_bytes(identity.certificate_pem)
    Path(configuration.network.tls.key).write_bytes(identity.key_pem)
    with zenoh.open(zenoh_configuration(configuration)):
        there = endpoint(fleet, "mbot-2")
        assert "not accepted" in why_no_session(there, fleet.security("alma"), 2.0)
        with pytest.raises(UnreachableError, match="not accepted"):
            open_session(there, fleet.security("alma"), 0.5)


@pytest.mark.usefixtures("robot")
def test_an_expired_certificate_is_refused_and_named(fleet: Fleet) -> None:
    old = fleet.expired("vera")
    assert "it has expired" in why_no_session(endpoint(fleet), old, 2.0)
    with pytest.raises(UnreachableError, match=r"vera\.pem: it has expired.*enroll --renew"):
        open_session(endpoint(fleet), old, 0.5)


@pytest.mark.usefixtures("robot")
def test_a_link_does_not_outlive_its_certificate(fleet: Fleet) -> None:
    ends_s = time.monotonic() + 6
    with open_session(endpoint(fleet), fleet.ending("vera", 6)) as session:
        assert ask(session, STATUS) == [b"mbot-1 status"]
        assert until(lambda: ask(session, STATUS) == [], 30)
    assert time.monotonic() > ends_s - 2  # X.509 counts whole seconds


@pytest.mark.usefixtures("robot")
def test_a_certificate_of_a_strangers_authority_is_refused(fleet: Fleet, tmp_path: Path) -> None:
    """The same name, signed by somebody else, who has even got hold of our authority's file."""
    forged = issue(make_authority(), Kind.PERSON, "alma")
    certificate, key = tmp_path / "alma.pem", tmp_path / "alma.key"
    certificate.write_bytes(forged.certificate_pem)
    key.write_bytes(forged.key_pem)
    stranger = LinkSecurity(fleet.folder.path / "authority.pem", certificate, key)
    assert "is it of the robot's authority?" in why_no_session(endpoint(fleet), stranger, 2.0)
    with pytest.raises(UnreachableError, match="does not accept"):
        open_session(endpoint(fleet), stranger, 0.5)


def test_a_revoked_person_is_out_when_the_robot_has_heard_of_it(tmp_path: Path) -> None:
    fleet = Fleet(tmp_path / "fleet")
    fleet.enrol("mbot-1", {"vera": [Right.VIEW], "max": [Right.DRIVE]})
    keys = fleet.security("max").certificate, fleet.security("max").key
    kept = [tmp_path / "max.pem", tmp_path / "max.key"]
    for source, copy in zip(keys, kept, strict=True):
        assert source is not None
        copy.write_bytes(source.read_bytes())
    max_ = LinkSecurity(fleet.folder.path / "authority.pem", *kept)
    with (
        TalkingRobot(fleet.configuration("mbot-1")),
        open_session(endpoint(fleet), max_) as session,
    ):
        assert ask(session, COMMAND) == [b"mbot-1 command"]
    fleet.enrolment.revoke("max")
    with (
        TalkingRobot(fleet.configuration("mbot-1")),
        open_session(endpoint(fleet), max_) as session,
    ):
        assert [ask(session, topic) for topic in QUERIES] == [[]] * len(QUERIES)


def test_robots_side_by_side_never_hear_each_other(fleet: Fleet, robot: TalkingRobot) -> None:
    """Same machine, same network, same authority: a command reaches the robot it names, only."""
    with (
        TalkingRobot(fleet.configuration("mbot-2")) as other,
        open_session(endpoint(fleet), fleet.security("alma")) as first,
        open_session(endpoint(fleet, "mbot-2"), fleet.security(NOBODY)) as second,
    ):
        robot.asked.clear()
        assert ask(first, COMMAND) == [b"mbot-1 command"]
        assert ask(second, COMMAND, "mbot-2") == [b"mbot-2 command"]
        # To the neighbour's key, and to all robots at once.
        assert ask(first, COMMAND, "mbot-2") == []
        assert ask(first, COMMAND, "*") == []
        assert (robot.asked, other.asked) == (["command"], ["command"])
        assert alive_robots(first, 1.0) == ["mbot-1"]
        assert alive_robots(second, 1.0) == ["mbot-2"]


def test_the_person_is_known_by_the_certificate(fleet: Fleet) -> None:
    assert person(fleet.security("vera")) == "vera"
    assert person(fleet.security_of_robot("mbot-2")) == "robot mbot-2"
    assert person(None) == ""
