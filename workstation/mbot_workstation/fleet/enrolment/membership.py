"""Enrolling: who becomes part of the fleet, with which rights, and who leaves it.

Every operation changes the fleet's folder and says which files have to be handed over for it to
take effect: a robot or router knows only what was copied to it.
"""

import getpass
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TypeVar

from msgspec import Struct, field, structs

from mbot_protocol.errors import ConfigurationError, RefusedError
from mbot_protocol.wire.access_rules import Kind, check_name
from mbot_protocol.wire.keys import Right, check_robot_id
from mbot_workstation.fleet.enrolment.bundles import (
    person_bundle,
    read_person_bundle,
    robot_bundle,
    router_bundle,
)
from mbot_workstation.fleet.enrolment.certificates import hosts_in, issue, make_authority
from mbot_workstation.fleet.enrolment.fleet_folder import FleetFolder
from mbot_workstation.fleet.enrolment.local_trial import place_beside
from mbot_workstation.fleet.enrolment.roll import (
    EnrolledPerson,
    EnrolledRobot,
    EnrolledRouter,
    Roll,
    read_roll,
)
from mbot_workstation.fleet.models.key_folder import KeyFolder

T = TypeVar("T")

RENEW_WITHIN = timedelta(days=60)
"""Whatever expires sooner is renewed when it is touched."""

MY_RIGHTS = (Right.PUSH, Right.DRIVE)
"""On a new robot, of whoever enrols it and could give them to himself anyway."""


class HandOver(Struct, frozen=True):
    """A file that has to get to a robot, router or person before anything changes there."""

    kind: Kind
    name: str
    path: Path = field(name="file")
    host: str | None = None

    def is_for_robot(self, robot_id: str) -> bool:
        """Whether it is that robot's."""
        return (self.kind, self.name) == (Kind.ROBOT, robot_id)


class Enrolment:
    """One fleet's folder, and the operations on it.

    Attributes:
        key_taken: the name of the key that came along by `join`; empty: none did.

    """

    def __init__(
        self,
        folder: FleetFolder | None = None,
        now: Callable[[], datetime] = lambda: datetime.now(UTC),
        own_keys: KeyFolder | None = None,
    ) -> None:
        self.folder = folder or FleetFolder()
        self._own_keys = own_keys or KeyFolder()
        self.key_taken = ""
        self._now = now

    def robot(
        self,
        robot_id: str,
        hosts: Sequence[str] = (),
        port: int | None = None,
        people: Mapping[str, Collection[Right]] | None = None,
        router: str | None = None,
        keys: Sequence[str] = (),
    ) -> list[HandOver]:
        """Enrol a robot, or change it.

        Args:
            robot_id: as its configuration has it.
            hosts: names and addresses it is reached by; none: as before, or ROBOT.local.
            port: where it listens; None: as before, or 7447.
            people: rights on this robot, by person; others keep theirs.
            router: the router it is behind; empty: none; None: as before.
            keys: public lines of all keys whose models it shall take; none: as before. Those of
                people who are given `push` here come on top: each gets one, in their file.

        Raises:
            ConfigurationError: a name or host is unusable.
            RefusedError: a name is taken or revoked, or the authority is elsewhere.

        """
        roll = self._begun()
        _check_free(roll, check_robot_id(robot_id), Kind.ROBOT)
        for name in people or {}:
            _check_free(roll, check_name(name), Kind.PERSON)
        if router and router not in roll.routers:
            raise ConfigurationError(
                f"no router {router!r} is enrolled: `workstation enroll {router} --router` does it"
            )
        new = EnrolledRobot((f"{robot_id}.local",), self._now(), people={roll.me: MY_RIGHTS})
        old = roll.robots.get(robot_id, new)
        given = {
            name: tuple(r for r in Right if r in rights) for name, rights in (people or {}).items()
        }
        robot = structs.replace(
            old,
            hosts=_checked(hosts) or old.hosts,
            port=old.port if port is None else port,
            people=old.people | given,
            router=old.router if router is None else router,
            keys=tuple(keys) or old.keys,
        )
        pushers = [name for name, own in given.items() if Right.PUSH in own and name != roll.me]
        if pushers:  # from now on the robot's file says whose models, also when it is nobody's
            robot = structs.replace(robot, keys=robot.keys or ())
        roll = structs.replace(roll, robots=roll.robots | {robot_id: robot})
        roll = self._certified(roll, {robot_id, *robot.people})
        return self._save(self._with_keys(roll, pushers), {robot_id})

    def keys_of(self, robot_id: str) -> tuple[str, ...]:
        """The public lines of the keys that a robot was sent with its certificates."""
        roll = read_roll(self.folder.path)
        return () if roll is None or robot_id not in roll.robots else roll.keys_of(robot_id)

    def place_beside(self, configuration: Path, robot_id: str) -> Path:
        """Put an enrolled robot's files beside a daemon's configuration, see `local_trial`."""
        folder = self.folder
        identity = folder.identity(Kind.ROBOT, robot_id)
        return place_beside(configuration, folder.roll(), robot_id, identity, folder.authority_pem)

    def router(
        self, name: str, hosts: Sequence[str] = (), port: int | None = None
    ) -> list[HandOver]:
        """Enrol a router, or change it; raises as `robot`."""
        roll = self._begun()
        _check_free(roll, check_name(name), Kind.ROUTER)
        old = roll.routers.get(name, EnrolledRouter((f"{name}.local",), self._now()))
        router = structs.replace(
            old, hosts=_checked(hosts) or old.hosts, port=old.port if port is None else port
        )
        roll = structs.replace(roll, routers=roll.routers | {name: router})
        return self._save(self._certified(roll, {name}), {name})

    def revoke(self, name: str) -> list[HandOver]:
        """Take somebody or something off the roll; the name is never given again.

        Raises:
            ConfigurationError: there is no such name.
            RefusedError: it is this workstation's own, or a router with robots behind it.

        """
        roll = self._begun()
        kind = roll.kind_of(name)
        if kind is None:
            raise ConfigurationError(
                f"nobody called {name!r} is enrolled, see `workstation enroll --list`"
            )
        if name == roll.me:
            raise RefusedError(f"{name} is this workstation itself: revoke it from no other place")
        behind = [robot_id for robot_id, robot in roll.robots.items() if robot.router == name]
        if kind is Kind.ROUTER and behind:
            raise RefusedError(
                f"{', '.join(behind)} would be cut off: first `workstation enroll {behind[0]} "
                "--via none`"
            )
        robots = {
            robot_id: structs.replace(robot, people=_without(robot.people, name))
            for robot_id, robot in _without(roll.robots, name).items()
        }
        roll = structs.replace(
            roll,
            robots=robots,
            people=_without(roll.people, name),
            routers=_without(roll.routers, name),
            revoked=(*roll.revoked, name),
        )
        hand_overs = self._save(roll)
        self.folder.delete(kind, name)
        return hand_overs

    def renew(self) -> list[HandOver]:
        """Renew everything that expires within 60 days."""
        roll = self._begun()
        return self._save(self._certified(roll, {*roll.robots, *roll.people, *roll.routers}))

    def join(self, path: Path) -> Roll:
        """Become one of another workstation's fleet, or take its news, and the key to sign with.

        Raises:
            ConfigurationError: the file is not one for a person.
            RefusedError: this workstation has a fleet of its own, or is of another one.

        """
        try:
            data = path.read_bytes()
        except OSError as error:
            raise ConfigurationError(f"cannot read {path}: {error.strerror}") from None
        roll, identity, authority_pem, signing_pem = read_person_bundle(data, str(path))
        folder = self.folder
        if folder.has_authority:
            raise RefusedError(
                f"this workstation has a fleet of its own in {folder.path}: join from another "
                "account, or move that folder away"
            )
        if read_roll(folder.path) is not None and folder.authority_pem != authority_pem:
            raise RefusedError(
                f"this workstation is of another fleet already: move {folder.path} away first"
            )
        if signing_pem:
            self.key_taken = self._own_keys.take(roll.me, signing_pem).name
        folder.write("authority.pem", authority_pem)
        folder.save_identity(Kind.PERSON, roll.me, identity)
        folder.save_roll(roll)
        return roll

    def _begun(self) -> Roll:
        """The roll; a fleet begins with its authority and the person at this workstation."""
        roll = read_roll(self.folder.path)
        if roll is not None:
            _ = self.folder.authority  # who has only joined may go no further
            return roll
        if not self.folder.has_authority:
            self.folder.save_authority(make_authority(self._now()))
        me = _own_name()
        return self._certified(Roll(me=me, people={me: EnrolledPerson(self._now())}), {me})

    def _certified(self, roll: Roll, names: Collection[str]) -> Roll:
        """The roll with a good certificate for each of the names, be it a new one."""
        robots, people, routers = dict(roll.robots), dict(roll.people), dict(roll.routers)
        for name in names:
            if name in robots:
                expires = self._certificate(Kind.ROBOT, name, robots[name].hosts)
                robots[name] = structs.replace(robots[name], expires=expires)
            elif name in routers:
                expires = self._certificate(Kind.ROUTER, name, routers[name].hosts)
                routers[name] = structs.replace(routers[name], expires=expires)
            else:
                expires = self._certificate(Kind.PERSON, name, ())
                old = people.get(name, EnrolledPerson(expires))
                people[name] = structs.replace(old, expires=expires)
        return structs.replace(roll, robots=robots, people=people, routers=routers)

    def _with_keys(self, roll: Roll, names: Collection[str]) -> Roll:
        """The roll with a key to sign models for each of the people, be it a new one."""
        keys, people = self.folder.signing_keys, dict(roll.people)
        for name in names:
            if not people[name].key:
                people[name] = structs.replace(people[name], key=keys.new(name).line)
        return structs.replace(roll, people=people)

    def _certificate(self, kind: Kind, name: str, hosts: Collection[str]) -> datetime:
        """Issue a certificate unless a good one is there; when it expires."""
        if self.folder.has_identity(kind, name):
            certificate = self.folder.identity(kind, name).certificate
            expires = certificate.not_valid_after_utc
            if expires > self._now() + RENEW_WITHIN and hosts_in(certificate) == set(hosts):
                return expires
        identity = issue(self.folder.authority, kind, name, hosts, self._now())
        self.folder.save_identity(kind, name, identity)
        return identity.expires

    def _save(self, roll: Roll, asked_for: Collection[str] = ()) -> list[HandOver]:
        """Write the roll and all files to hand over; those that are new or were asked for."""
        folder, authority_pem = self.folder, self.folder.authority_pem
        folder.save_roll(roll)
        hand_overs: list[HandOver] = []
        for kind, names in (
            (Kind.ROUTER, roll.routers),
            (Kind.ROBOT, roll.robots),
            (Kind.PERSON, _without(roll.people, roll.me)),
        ):
            for name in names:
                identity = folder.identity(kind, name)
                if kind is Kind.PERSON:
                    signing = folder.signing_keys.pem(name) if roll.people[name].key else b""
                    data = person_bundle(roll, name, identity, authority_pem, signing)
                else:
                    bundle = router_bundle if kind is Kind.ROUTER else robot_bundle
                    data = bundle(roll, name, identity, authority_pem)
                if folder.save_bundle(kind, name, data) or name in asked_for:
                    host = "" if kind is Kind.PERSON else _host(roll, kind, name)
                    hand_overs.append(
                        HandOver(kind, name, folder.bundle_path(kind, name), host or None)
                    )
        return hand_overs


def _host(roll: Roll, kind: Kind, name: str) -> str:
    return (roll.robots if kind is Kind.ROBOT else roll.routers)[name].hosts[0]


def _without(names: Mapping[str, T], name: str) -> dict[str, T]:
    return {key: value for key, value in names.items() if key != name}


def _check_free(roll: Roll, name: str, kind: Kind) -> None:
    """Names are given once, to whatever: a certificate must mean one thing for ever."""
    if name in roll.revoked:
        raise RefusedError(f"{name!r} was revoked and cannot come back: choose another name")
    held_by = roll.kind_of(name)
    if held_by not in (None, kind):
        raise RefusedError(f"{name!r} is a {held_by.value} already: choose another name")


def _checked(hosts: Sequence[str]) -> tuple[str, ...]:
    for host in hosts:
        if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9.-]*|[0-9A-Fa-f]*:[0-9A-Fa-f:.]+", host):
            raise ConfigurationError(
                f"host is {host!r}, expected a name or an address, such as mbot-1.local"
            )
    return tuple(dict.fromkeys(hosts))


def _own_name() -> str:
    """The user's name, as far as it can stand in a certificate."""
    try:
        user = getpass.getuser()
    except (KeyError, OSError):  # no such user in a container
        user = ""
    return re.sub(r"[^a-z0-9_-]", "-", user.lower()).lstrip("-_")[:32] or "me"
