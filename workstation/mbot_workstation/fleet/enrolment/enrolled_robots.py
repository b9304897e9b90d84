"""Where to connect to, for what a person calls a robot: an enrolled name, or an address."""

import socket
import sys
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta

from mbot_protocol.did_you_mean import did_you_mean
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.fleet.link.address import Destination, parse_address
from mbot_workstation.fleet.link.security import LinkSecurity
from mbot_workstation.wording import typed

WARN_BEFORE = timedelta(days=30)


def find_destination(
    text: str, robot_id: str | None = None, security: LinkSecurity | None = None
) -> Destination:
    """The enrolled robot of that name, or else an address; certificates given by hand win.

    Raises:
        ConfigurationError: the text is neither, it names another robot than `robot_id`, or the
            fleet's folder is damaged.

    """
    if security is None and (enrolled := _enrolled(text)) is not None:
        if robot_id not in (None, enrolled.robot_id):
            raise ConfigurationError(
                f"--robot is the enrolled robot {text}, but --id is {robot_id}: leave --id out, or "
                f"give --robot {robot_id}"
            )
        return enrolled
    if security is None:
        _refuse_unknown(text)
    return Destination(parse_address(text, secured=security is not None), robot_id, security)


def find_destinations(
    texts: Sequence[str], security: LinkSecurity | None = None
) -> list[Destination]:
    """All of them; without any, the enrolled robots, and without those this machine.

    Raises:
        ConfigurationError: as `find_destination`.

    """
    return [find_destination(text, None, security) for text in texts or _names() or [""]]


def _names() -> list[str]:
    from mbot_workstation.fleet.enrolment.fleet_folder import fleet_directory
    from mbot_workstation.fleet.enrolment.roll import read_roll

    roll = read_roll(fleet_directory())
    return [] if roll is None else sorted(roll.robots)


def _enrolled(name: str) -> Destination | None:
    from mbot_workstation.fleet.enrolment.fleet_folder import FleetFolder
    from mbot_workstation.fleet.enrolment.roll import read_roll

    folder = FleetFolder()
    roll = read_roll(folder.path)
    if roll is None or name not in roll.robots:
        return None
    _warn_of_expiry(roll.people[roll.me].expires)
    return Destination(roll.endpoint(name), name, folder.security(roll.me))


def _refuse_unknown(text: str) -> None:
    """Where robots are enrolled, a word that is neither one of them nor a host is a slip."""
    names = _names()
    if not names or not text.replace("-", "").isalnum():
        return
    try:
        socket.getaddrinfo(text, None)
    except OSError:
        raise ConfigurationError(
            f"no robot {text!r} is enrolled here, only {', '.join(names)}, and no host has that "
            f"name: {_way_in(text)}, or give its IP address{did_you_mean(text, names)}"
        ) from None


def _way_in(robot_id: str) -> str:
    """Who has only joined a fleet can't enrol anything."""
    from mbot_workstation.fleet.enrolment.fleet_folder import FleetFolder

    folder = FleetFolder()
    if folder.has_authority:
        return f"`workstation enroll {typed(robot_id)}` enrols it"
    return (
        "ask whoever gave you your file for `workstation enroll "
        f"{typed(robot_id)} --person {typed(folder.roll().me)}` and join by the new one"
    )


def _warn_of_expiry(expires: datetime) -> None:
    if expires - datetime.now(UTC) < WARN_BEFORE:
        print(
            f"workstation: note: your certificate is valid until {expires:%Y-%m-%d}; `workstation "
            "enroll --renew` renews it, where the fleet was begun",
            file=sys.stderr,
        )
