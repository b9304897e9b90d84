"""Certificates in place for a daemon on this machine: enrolment tried without copying anything."""

import tomllib
from pathlib import Path

from msgspec import UNSET

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.files import atomic_file
from mbot_protocol.files.text_file import read_text
from mbot_workstation.fleet.enrolment.bundles import (
    TRUSTED_KEYS_FILE,
    enrolment_toml,
    trusted_keys_toml,
)
from mbot_workstation.fleet.enrolment.certificates import Identity
from mbot_workstation.fleet.enrolment.roll import Roll

LOOPBACK = ("127.0.0.1", "localhost")


def robot_id_in(configuration: Path) -> str:
    """The robot that a daemon's configuration is for.

    Raises:
        ConfigurationError: it can't be read, or names none.

    """
    try:
        robot_id = tomllib.loads(read_text(configuration)).get("robot_id")
    except tomllib.TOMLDecodeError as error:
        raise ConfigurationError(f"{configuration} is not valid TOML: {error}") from None
    if not isinstance(robot_id, str):
        raise ConfigurationError(f"{configuration} has no robot_id; is it a robot's configuration?")
    return robot_id


def place_beside(
    configuration: Path, roll: Roll, robot_id: str, robot: Identity, authority_pem: bytes
) -> Path:
    """Put a robot's certificates, enrolment.toml and keys beside a daemon's configuration.

    The daemon then listens on loopback only. Returns the folder of the certificates.

    Raises:
        ConfigurationError: a file can't be written.

    """
    folder = configuration.absolute().parent / "tls"
    text = enrolment_toml(roll, robot_id, str(folder), LOOPBACK[0])
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        atomic_file.replace(folder / "ca.pem", authority_pem)
        atomic_file.replace(folder / "robot.pem", robot.certificate_pem)
        atomic_file.replace(folder / "robot.key", robot.key_pem, mode=0o600)
        atomic_file.replace(folder.with_name("enrolment.toml"), text.encode())
        if roll.robots[robot_id].keys is not UNSET:
            text = trusted_keys_toml(roll.keys_of(robot_id))
            atomic_file.replace(folder.with_name(TRUSTED_KEYS_FILE), text.encode())
    except OSError as error:
        raise ConfigurationError(f"can't write beside {configuration}: {error.strerror}") from None
    return folder
