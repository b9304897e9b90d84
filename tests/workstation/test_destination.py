import socket
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.wire.access_rules import Kind
from mbot_workstation.fleet.enrolment.enrolled_robots import find_destination, find_destinations
from mbot_workstation.fleet.enrolment.fleet_folder import FleetFolder, fleet_directory
from mbot_workstation.fleet.enrolment.membership import Enrolment
from mbot_workstation.fleet.enrolment.roll import ROLL_FILE
from mbot_workstation.fleet.link.security import LinkSecurity


@pytest.fixture
def enrolment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Enrolment:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    enrolment = Enrolment()
    enrolment.router("lab")
    enrolment.robot("mbot-1", ["10.0.0.7"], port=7450)
    enrolment.robot("mbot-2", router="lab")
    return enrolment


def test_an_enrolled_robot_is_found_by_its_name(enrolment: Enrolment) -> None:
    found = find_destination("mbot-1")
    assert (str(found.endpoint), found.robot_id) == ("tls/10.0.0.7:7450", "mbot-1")
    assert found.security == enrolment.folder.security(enrolment.folder.roll().me)


def test_one_behind_a_router_is_reached_by_it(enrolment: Enrolment) -> None:
    assert str(find_destination("mbot-2").endpoint) == "tls/lab.local:7447"


@pytest.mark.usefixtures("enrolment")
def test_everything_else_is_an_address(tmp_path: Path) -> None:
    assert str(find_destination("").endpoint) == "tcp/127.0.0.1:7447"
    found = find_destination("mbot-1:7447", "mbot-1")
    assert (str(found.endpoint), found.robot_id, found.security) == (
        "tcp/mbot-1:7447",
        "mbot-1",
        None,
    )
    file = tmp_path / "ca.pem"
    file.touch()
    security = LinkSecurity(file)
    assert find_destination("mbot-1", None, security).security is security
    with pytest.raises(ConfigurationError, match="robot address"):
        find_destination("a b")


@pytest.mark.usefixtures("enrolment")
def test_without_a_name_all_enrolled_robots_are_meant() -> None:
    assert [found.robot_id for found in find_destinations([])] == ["mbot-1", "mbot-2"]
    assert [str(found.endpoint) for found in find_destinations(["10.1.1.1", "mbot-1"])] == [
        "tcp/10.1.1.1:7447",
        "tls/10.0.0.7:7450",
    ]


def test_without_a_fleet_this_machine_is_meant(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    [found] = find_destinations([])
    assert (str(found.endpoint), found.robot_id) == ("tcp/127.0.0.1:7447", None)
    monkeypatch.delenv("XDG_CONFIG_HOME")
    assert fleet_directory() == Path.home() / ".config" / "mbot-agent" / "fleet"


def test_a_certificate_that_ends_soon_is_mentioned(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    long_ago = datetime.now(UTC) - timedelta(days=350)
    Enrolment(FleetFolder(), lambda: long_ago).robot("mbot-1")
    assert find_destination("mbot-1").robot_id == "mbot-1"
    assert "your certificate is valid until" in capsys.readouterr().err


def test_a_damaged_roll_is_named(enrolment: Enrolment) -> None:
    (enrolment.folder.path / ROLL_FILE).write_text("{")
    with pytest.raises(ConfigurationError, match=r"roll\.json is not a roll of a fleet"):
        find_destination("mbot-1")


def test_a_missing_certificate_is_named(enrolment: Enrolment) -> None:
    me = enrolment.folder.roll().me
    (enrolment.folder.path / "persons" / f"{me}.key").unlink()
    with pytest.raises(ConfigurationError, match="no such file"):
        find_destination("mbot-1")


@pytest.mark.usefixtures("enrolment")
def test_a_name_that_nobody_has_names_those_that_are_enrolled(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def unknown(host: str, _port: None) -> list[str]:
        if host == "localhost":
            return [host]
        raise socket.gaierror

    monkeypatch.setattr(socket, "getaddrinfo", unknown)
    with pytest.raises(ConfigurationError, match=r"only mbot-1, mbot-2, .* did you mean mbot-2"):
        find_destination("mbot2")
    assert find_destination("localhost").endpoint.host == "localhost"
    assert find_destination("mbot-3.local").endpoint.host == "mbot-3.local"


def test_who_has_only_joined_is_told_whom_to_ask(
    enrolment: Enrolment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    enrolment.robot("mbot-1", people={"max": []})
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "max"))
    Enrolment().join(enrolment.folder.bundle_path(Kind.PERSON, "max"))
    with pytest.raises(ConfigurationError, match="`workstation enroll nobody-here --person max`"):
        find_destination("nobody-here")
