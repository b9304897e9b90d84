from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from mbot_agent.configuration import Access, Configuration, Network, Tls
from mbot_agent.doctor import _network as network_finding  # pyright: ignore[reportPrivateUsage]
from mbot_agent.network.tls_files import check_certificates
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.wire.access_rules import Kind
from mbot_protocol.wire.keys import Right
from mbot_workstation.fleet.enrolment.certificates import Identity, issue, make_authority

AUTHORITY = make_authority()


def files(folder: Path, identity: Identity, authority: Identity = AUTHORITY) -> Tls:
    (folder / "ca.pem").write_bytes(authority.certificate_pem)
    (folder / "robot.pem").write_bytes(identity.certificate_pem)
    (folder / "robot.key").write_bytes(identity.key_pem)
    return Tls(*(str(folder / name) for name in ("ca.pem", "robot.pem", "robot.key")))


def robot(name: str = "mbot-1", **named: Any) -> Identity:
    return issue(AUTHORITY, Kind.ROBOT, name, ["mbot-1.local"], **named)


def test_a_good_certificate_says_how_long(tmp_path: Path) -> None:
    validity = check_certificates(files(tmp_path, robot()), "mbot-1")
    assert validity.usable
    assert validity.advice == ""
    assert validity.until == f"{datetime.now(UTC) + timedelta(days=365):%Y-%m-%d}"


def test_one_that_ends_soon_is_said_to(tmp_path: Path) -> None:
    validity = check_certificates(files(tmp_path, robot(days=20)), "mbot-1")
    assert validity.usable
    assert "expires on" in validity.advice
    assert "enroll --renew" in validity.advice


@pytest.mark.parametrize(("moved_days", "words"), [(-400, "has expired"), (400, "not valid yet")])
def test_one_out_of_its_time_is_no_error_but_unusable(
    tmp_path: Path, moved_days: int, words: str
) -> None:
    """The clock may be what is wrong: the robot must start nevertheless."""
    moved = robot(now=datetime.now(UTC) + timedelta(days=moved_days))
    validity = check_certificates(files(tmp_path, moved), "mbot-1")
    assert not validity.usable
    assert words in validity.advice


def test_files_that_do_not_belong_together_are_named(tmp_path: Path) -> None:
    whole, other = robot(), robot()
    cases = {
        "not a certificate with its key": (
            Identity(whole.certificate_pem, other.key_pem),
            AUTHORITY,
            "mbot-1",
        ),
        "is not accepted by": (whole, make_authority(), "mbot-1"),
        "is that of robot mbot-1, this is robot mbot-2": (whole, AUTHORITY, "mbot-2"),
        "is that of router lab": (issue(AUTHORITY, Kind.ROUTER, "lab"), AUTHORITY, "mbot-1"),
        "unsuitable certificate purpose": (issue(AUTHORITY, Kind.PERSON, "x"), AUTHORITY, "mbot-1"),
        "ca.pem holds no certificate": (whole, Identity(b"nothing", b""), "mbot-1"),
    }
    for words, (identity, authority, robot_id) in cases.items():
        with pytest.raises(ConfigurationError) as caught:
            check_certificates(files(tmp_path, identity, authority), robot_id)
        assert words in str(caught.value)
        assert str(caught.value).startswith("network.tls.")


@pytest.mark.parametrize("name", ["ca.pem", "robot.pem", "robot.key"])
def test_a_missing_file_is_named(tmp_path: Path, name: str) -> None:
    tls = files(tmp_path, robot())
    (tmp_path / name).unlink()
    with pytest.raises(ConfigurationError, match=rf"cannot read .*{name}: No such file"):
        check_certificates(tls, "mbot-1")


def test_the_check_says_who_may_talk_and_until_when(tmp_path: Path) -> None:
    for days, verdict in ((365, "ok"), (20, "warning"), (-1, "failed")):
        tls = files(tmp_path, robot(days=days))
        network = Network(listen=("tls/0.0.0.0:7447",), tls=tls)
        access = Access({"rosa": (Right.DRIVE,)}, ("lab",))
        configuration = Configuration(robot_id="mbot-1", network=network, access=access)
        finding = network_finding(configuration)
        assert finding.verdict == verdict, finding.detail
        if verdict == "ok":
            assert "for rosa, by router lab, certificate until" in finding.detail
