"""Certificates for a daemon on this machine, in place."""

import tomllib
from pathlib import Path

import pytest

from mbot_agent.configuration_files import complete
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.fleet.enrolment.fleet_folder import FleetFolder
from mbot_workstation.fleet.enrolment.local_trial import LOOPBACK, robot_id_in
from mbot_workstation.fleet.enrolment.membership import Enrolment
from mbot_workstation.fleet.models.signing_key import SigningKey


def test_everything_lies_beside_the_configuration(tmp_path: Path) -> None:
    configuration = tmp_path / "robot" / "robot.toml"
    configuration.parent.mkdir()
    configuration.write_text('robot_id = "virtual"')
    enrolment = Enrolment(FleetFolder(tmp_path / "fleet"))
    enrolment.robot(robot_id_in(configuration), LOOPBACK)
    folder = enrolment.place_beside(configuration, "virtual")
    written = tomllib.loads((configuration.parent / "enrolment.toml").read_text())
    assert written["network"]["listen"] == ["tls/127.0.0.1:7447"], "nobody else is let in"
    assert {Path(path) for path in written["network"]["tls"].values()} == set(folder.iterdir())
    assert not (configuration.parent / "trusted-keys.toml").exists()
    assert (folder / "robot.key").stat().st_mode & 0o077 == 0


def test_keys_lie_there_too(tmp_path: Path) -> None:
    configuration = tmp_path / "robot.toml"
    configuration.write_text('robot_id = "virtual"')
    line = SigningKey.ephemeral("rosa").public.line
    enrolment = Enrolment(FleetFolder(tmp_path / "fleet"))
    enrolment.robot("virtual", LOOPBACK, keys=[line])
    enrolment.place_beside(configuration, "virtual")
    assert complete(configuration).trust.keys == (line,)


@pytest.mark.parametrize("text", ["", "robot_id = 3", "robot_id ="])
def test_what_is_no_robots_configuration_is_named(tmp_path: Path, text: str) -> None:
    (tmp_path / "robot.toml").write_text(text)
    with pytest.raises(ConfigurationError, match=r"robot\.toml"):
        robot_id_in(tmp_path / "robot.toml")
