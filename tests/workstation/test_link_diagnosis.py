import re
from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh

from mbot_agent.network.zenoh_settings import zenoh_configuration
from mbot_protocol.errors import UnreachableError
from mbot_protocol.wire.keys import ALIVE
from mbot_workstation.fleet.link import robot_session
from mbot_workstation.fleet.link.address import Endpoint
from mbot_workstation.fleet.link.diagnosis import why_no_session, why_unreachable
from mbot_workstation.fleet.link.robot_link import RobotLink
from mbot_workstation.fleet.link.security import LinkSecurity

from ..end_to_end.fleet import Fleet
from ..free_port import free_port
from .fake_robot import FakeRobot


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Fleet:
    fleet = Fleet(tmp_path_factory.mktemp("fleet"))
    fleet.enrol("mbot-1", {"rosa": []})
    return fleet


@pytest.fixture(scope="module")
def strangers(tmp_path_factory: pytest.TempPathFactory) -> LinkSecurity:
    """Somebody of another fleet, with everything that goes with it."""
    fleet = Fleet(tmp_path_factory.mktemp("strangers"))
    fleet.enrol("mbot-1", {"mallory": []})
    return fleet.security("mallory")


@pytest.fixture(scope="module")
def secured(fleet: Fleet) -> Iterator[Endpoint]:
    """A robot that asks for a certificate of its authority: the daemon's own configuration."""
    with (
        zenoh.open(zenoh_configuration(fleet.configuration("mbot-1"))) as session,
        session.liveliness().declare_token(ALIVE.key("mbot-1")),
    ):
        yield fleet.folder.roll().endpoint("mbot-1")


def test_the_right_certificates_open_the_link(secured: Endpoint, fleet: Fleet) -> None:
    me = fleet.security(fleet.folder.roll().me)
    with RobotLink(f"{secured.host}:{secured.port}", None, me) as link:
        assert link.robot_id == "mbot-1"


def wrong_certificates(fleet: Fleet, strangers: LinkSecurity) -> dict[str, LinkSecurity]:
    ours = fleet.security("rosa")
    return {
        r"robot's certificate is not accepted: .*authority": LinkSecurity(
            strangers.ca, ours.certificate, ours.key
        ),
        r"asks for a certificate: give --certificate and --key": LinkSecurity(ours.ca),
        r"does not accept .*mallory\.pem; is it of": LinkSecurity(
            ours.ca, strangers.certificate, strangers.key
        ),
        r"are not a certificate with its key": LinkSecurity(
            ours.ca, ours.certificate, strangers.key
        ),
        r"does not accept .*rosa\.pem: it has expired": fleet.expired("rosa"),
        r"holds no certificate authority": LinkSecurity(Path(str(ours.key))),
    }


def test_the_wrong_certificates_are_told_apart(
    secured: Endpoint, fleet: Fleet, strangers: LinkSecurity
) -> None:
    for text, wrong in wrong_certificates(fleet, strangers).items():
        assert re.search(text, why_no_session(secured, wrong, 2.0)), text


@pytest.mark.usefixtures("secured")
def test_a_name_that_is_not_in_the_certificate_is_told(fleet: Fleet) -> None:
    other = Endpoint("tls", "localhost", fleet.ports["mbot-1"])
    words = "not for localhost; use another of the robot's names, or enrol it with --host localhost"
    assert words in why_no_session(other, fleet.security("rosa"), 2.0)


def test_tcp_to_a_robot_that_speaks_tls_is_told(
    secured: Endpoint, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(robot_session.open_session, "__defaults__", (0.5,))
    advice = rf"it speaks TLS: name an enrolled robot .*, or use {secured} with --ca"
    with (
        pytest.raises(UnreachableError, match=advice),
        RobotLink(f"tcp/{secured.host}:{secured.port}"),
    ):
        pass


def test_a_robot_that_does_not_listen_for_tls_may_lack_its_enrolment() -> None:
    nobody = Endpoint("tls", "127.0.0.1", free_port())
    assert "has its enrolment been copied" in str(why_unreachable(nobody, 2.0))


def test_tls_to_a_robot_that_speaks_tcp_is_told(robot: FakeRobot, fleet: Fleet) -> None:
    endpoint = Endpoint("tls", "127.0.0.1", robot.port)
    assert "no TLS is spoken there" in why_no_session(endpoint, fleet.security("rosa"), 0.5)
