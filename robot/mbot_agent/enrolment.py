"""What `workstation enroll` wrote for this robot, put into the configuration: network and people.

A file of its own beside config.toml, so that a new person or certificate is copied, not edited in.
"""

from pathlib import Path

import msgspec
from msgspec import Struct

from mbot_agent.configuration import Access, Configuration, Network
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.toml_file import read_toml

ENROLMENT_FILE = "enrolment.toml"


class Enrolment(Struct, frozen=True, forbid_unknown_fields=True):
    """The file's content."""

    robot_id: str
    network: Network
    access: Access


def enrolled(configuration: Configuration, origin: Path) -> Configuration:
    """The configuration with the network and people of the enrolment, if there is one.

    Args:
        configuration: as read.
        origin: its file; the enrolment is looked for beside it, and errors name it.

    Raises:
        ConfigurationError: the enrolment is unusable or another robot's, or certificates or
            people stand in both files: neither could win without somebody being let in by the
            other.

    """
    path = origin.parent / ENROLMENT_FILE
    if not path.exists():
        return configuration
    enrolment = read_toml(path, Enrolment)
    if enrolment.robot_id != configuration.robot_id:
        raise ConfigurationError(
            f"{path} is for robot {enrolment.robot_id!r}, but robot_id in {origin} is "
            f"{configuration.robot_id!r}: copy this robot's, or change robot_id"
        )
    if configuration.network.tls is not None or configuration.access != Access():
        raise ConfigurationError(
            f"{origin} has [network.tls] or [access], and {path} has them too: delete one of the "
            "two"
        )
    try:
        return msgspec.structs.replace(
            configuration, network=enrolment.network, access=enrolment.access
        )
    except ConfigurationError as error:
        raise ConfigurationError(f"{path}: {error}") from None
