"""The roll of a fleet: robots, people and routers, who may do what, and where robots are reached.

One JSON file in the fleet's folder. A workstation that has joined somebody else's fleet has a roll
too, with what it needs to know.
"""

from datetime import datetime
from pathlib import Path

import msgspec
from msgspec import UNSET, Struct, UnsetType

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.wire.access_rules import Kind, check_name
from mbot_protocol.wire.keys import DEFAULT_PORT, Right, check_robot_id
from mbot_workstation.fleet.link.address import Endpoint

ROLL_FILE = "roll.json"
SCHEMA = 1


class EnrolledPerson(Struct, frozen=True, forbid_unknown_fields=True):
    """A person's certificate.

    Attributes:
        key: the public line of the signing key made for them; unset: they have none of ours.

    """

    expires: datetime
    key: str | UnsetType = UNSET


class EnrolledRouter(Struct, frozen=True, forbid_unknown_fields=True):
    """A router, and the names it is reached by; the first one is used."""

    hosts: tuple[str, ...]
    expires: datetime
    port: int = DEFAULT_PORT

    @property
    def endpoint(self) -> Endpoint:
        """Where to connect to."""
        return Endpoint("tls", self.hosts[0], self.port)


class EnrolledRobot(Struct, frozen=True, forbid_unknown_fields=True):
    """A robot, the names it is reached by, its people, and the router it is behind, if any.

    Attributes:
        keys: the public lines of the keys sent along, whose models it takes; unset: none were.

    """

    hosts: tuple[str, ...]
    expires: datetime
    port: int = DEFAULT_PORT
    people: dict[str, tuple[Right, ...]] = {}
    router: str = ""
    keys: tuple[str, ...] | UnsetType = UNSET

    @property
    def endpoint(self) -> Endpoint:
        """Where to connect to, unless it is by the router."""
        return Endpoint("tls", self.hosts[0], self.port)


class Roll(Struct, frozen=True, forbid_unknown_fields=True):
    """Everybody.

    Attributes:
        me: whose certificate this workstation shows.
        revoked: names that may not be given again: old certificates would be let in by them.

    """

    me: str
    robots: dict[str, EnrolledRobot] = {}
    people: dict[str, EnrolledPerson] = {}
    routers: dict[str, EnrolledRouter] = {}
    revoked: tuple[str, ...] = ()
    schema: int = SCHEMA

    def __post_init__(self) -> None:
        try:
            for robot_id in self.robots:
                check_robot_id(robot_id)
            for name in (*self.people, *self.routers):
                check_name(name)
        except ConfigurationError as error:
            raise ValueError(str(error)) from None
        if self.me not in self.people:
            raise ValueError(f"{self.me!r} is not among the people")
        for name, entry in (*self.robots.items(), *self.routers.items()):
            if not entry.hosts:
                raise ValueError(f"{name} has no hosts")
        for name, robot in self.robots.items():
            if robot.router and robot.router not in self.routers:
                raise ValueError(f"the router of {name} is missing")

    def endpoint(self, robot_id: str) -> Endpoint:
        """Where a workstation connects to for a robot of the roll."""
        robot = self.robots[robot_id]
        return self.routers[robot.router].endpoint if robot.router else robot.endpoint

    def keys_of(self, robot_id: str) -> tuple[str, ...]:
        """The public lines sent to a robot: those it was enrolled with, and those made for people
        who may push to it.
        """
        robot = self.robots[robot_id]
        made = [self.people[name].key for name, own in robot.people.items() if Right.PUSH in own]
        return tuple(dict.fromkeys([*(robot.keys or ()), *(line for line in made if line)]))

    def kind_of(self, name: str) -> Kind | None:
        """What is enrolled under a name; None if nothing is."""
        holders = {
            Kind.ROBOT: self.robots,
            Kind.PERSON: self.people,
            Kind.ROUTER: self.routers,
        }
        return next((kind for kind, names in holders.items() if name in names), None)


def read_roll(folder: Path) -> Roll | None:
    """The roll in a fleet's folder; None if there is none.

    Raises:
        ConfigurationError: it can't be read.

    """
    path = folder / ROLL_FILE
    try:
        return decode_roll(path.read_bytes(), str(path))
    except FileNotFoundError:
        return None
    except OSError as error:
        raise ConfigurationError(f"cannot read {path}: {error.strerror}") from None


def decode_roll(data: bytes, origin: str) -> Roll:
    """A roll from its bytes.

    Raises:
        ConfigurationError: they are none; `origin` names them.

    """
    try:
        roll = msgspec.json.decode(data, type=Roll)
    except msgspec.MsgspecError as error:
        raise ConfigurationError(f"{origin} is not a roll of a fleet: {error}") from None
    if roll.schema > SCHEMA:
        raise ConfigurationError(f"{origin} is of a newer version of this software: upgrade it")
    return roll


def encode_roll(roll: Roll) -> bytes:
    """The roll as its file holds it, for people to read as well."""
    return msgspec.json.format(msgspec.json.encode(roll), indent=2) + b"\n"
