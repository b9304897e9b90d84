import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh

from mbot_agent.configuration import Network, Tls
from mbot_agent.link import zenoh_configuration
from mbot_protocol.errors import UnreachableError
from mbot_protocol.keys import ALIVE
from mbot_workstation import robot_session
from mbot_workstation.address import Endpoint
from mbot_workstation.link_diagnosis import why_no_session
from mbot_workstation.link_security import LinkSecurity
from mbot_workstation.robot_link import RobotLink

from .fake_robot import FakeRobot, free_port


def openssl(*arguments: str | Path) -> None:
    subprocess.run(["openssl", *map(str, arguments)], check=True, capture_output=True, timeout=30)


@pytest.fixture(scope="module")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two authorities, the robot's certificate, the workstation's, and one of the wrong one."""
    folder = tmp_path_factory.mktemp("certificates")
    curve = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-days", "2")
    signed_by = {"ca": None, "other": None, "robot": "ca", "workstation": "ca", "stranger": "other"}
    for name, authority in signed_by.items():
        subject: list[str | Path] = ["-subj", f"/CN={name}"]
        if authority is not None:
            subject += ["-CA", folder / f"{authority}.pem", "-CAkey", folder / f"{authority}.key"]
            subject += ["-addext", "subjectAltName=DNS:localhost,IP:127.0.0.1"]
            subject += ["-addext", "basicConstraints=critical,CA:FALSE"]
        files = ("-keyout", folder / f"{name}.key", "-out", folder / f"{name}.pem")
        openssl("req", "-x509", *curve, *subject, *files)
    return folder


@pytest.fixture(scope="module")
def secured(certificates: Path) -> Iterator[Endpoint]:
    """A robot that asks for a certificate of its authority: the daemon's own configuration."""
    endpoint = Endpoint("tls", "127.0.0.1", free_port())
    tls = Tls(*(str(certificates / name) for name in ("ca.pem", "robot.pem", "robot.key")))
    network = Network(listen=(str(endpoint),), tls=tls)
    with (
        zenoh.open(zenoh_configuration(network)) as session,
        session.liveliness().declare_token(ALIVE.key("mbot-1")),
    ):
        yield endpoint


def security(folder: Path, ca: str, name: str | None, key: str | None = None) -> LinkSecurity:
    if name is None:
        return LinkSecurity(folder / f"{ca}.pem")
    return LinkSecurity(folder / f"{ca}.pem", folder / f"{name}.pem", folder / f"{key or name}.key")


def test_the_right_certificates_open_the_link(secured: Endpoint, certificates: Path) -> None:
    right = security(certificates, "ca", "workstation")
    with RobotLink(f"{secured.host}:{secured.port}", None, right) as link:
        assert link.robot_id == "mbot-1"


@pytest.mark.parametrize(
    ("ca", "name", "key", "text"),
    [
        ("other", "workstation", None, "robot's certificate is not accepted"),
        ("ca", None, None, "asks for a certificate: give --certificate and --key"),
        ("ca", "stranger", None, "does not accept .*stranger.pem"),
        ("ca", "workstation", "stranger", "are no certificate with its key"),
    ],
)
def test_the_wrong_certificates_are_told_apart(
    secured: Endpoint, certificates: Path, ca: str, name: str | None, key: str | None, text: str
) -> None:
    wrong = security(certificates, ca, name, key)
    assert re.search(text, why_no_session(secured, wrong, 2.0))


def test_tcp_to_a_robot_that_speaks_tls_is_told(
    secured: Endpoint, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(robot_session.open_session, "__defaults__", (0.5,))
    advice = f"it speaks TLS: use {secured} with --ca"
    with (
        pytest.raises(UnreachableError, match=advice),
        RobotLink(f"tcp/{secured.host}:{secured.port}"),
    ):
        pass


def test_tls_to_a_robot_that_speaks_tcp_is_told(robot: FakeRobot, certificates: Path) -> None:
    endpoint = Endpoint("tls", "127.0.0.1", robot.port)
    right = security(certificates, "ca", "workstation")
    assert "no TLS is spoken there" in why_no_session(endpoint, right, 0.5)


def test_a_file_that_is_no_certificate_is_named(secured: Endpoint, certificates: Path) -> None:
    wrong = LinkSecurity(certificates / "ca.key")
    assert "holds no certificate authority" in why_no_session(secured, wrong, 0.5)
