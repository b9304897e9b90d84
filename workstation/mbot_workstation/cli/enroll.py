"""`workstation enroll`: certificates and rights for robots, people and routers."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.wire.keys import Right
from mbot_workstation.cli.common_options import hosts_option, json_option
from mbot_workstation.cli.options import argument, option, with_options
from mbot_workstation.cli.presenter import Answer, table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.table import Table

    from mbot_workstation.fleet.enrolment.membership import Enrolment, HandOver
    from mbot_workstation.fleet.enrolment.roll import Roll

_OTHER = "Instead of enrolling"


@dataclass(frozen=True, slots=True, kw_only=True)
class EnrollOptions:
    """What `enroll` takes."""

    name: str = argument(
        "Its robot_id; a router's name with --router.", default="", metavar="[ROBOT]"
    )
    hosts: list[str] | None = hosts_option()
    port: int | None = option(None, "Where it listens; 7447 if never given.", min=1, max=65535)
    people: list[str] | None = option(
        None, "Whom to give --right; may be repeated.", "--person", metavar="NAME"
    )
    rights: list[Right] | None = option(
        None, "view, push or drive; may be repeated. view if not given.", "--right"
    )
    via: str | None = option(
        None, "The router the robot is behind; none: no longer.", metavar="ROUTER"
    )
    here: Path | None = option(
        None,
        "Its daemon runs on this machine with this configuration: put the certificates beside it.",
        metavar="robot.toml",
    )
    router: bool = option(False, "It is a router (zenohd), not a robot.", "--router")
    listing: bool = option(
        False, "Show everybody, their rights, and when certificates expire.", "--list", panel=_OTHER
    )
    revoke: str | None = option(
        None, "Remove a person, robot or router.", panel=_OTHER, metavar="NAME"
    )
    renew: bool = option(False, "Renew all that expires within 60 days.", "--renew", panel=_OTHER)
    join: Path | None = option(
        None, "Join a fleet by the file made for you.", panel=_OTHER, metavar="FILE"
    )
    as_json: bool = json_option()


@with_options
def enroll(options: EnrollOptions) -> Answer:
    """Make certificates and rights for a robot and its people, and print how to copy them there.

    Whoever enrols a robot may push models to it and drive it. Others get the rights that you give:
    **view** shows status and telemetry and may stop the robot, **push** may also send models,
    **drive** may also let it run and drive it by hand. Afterwards every command finds the robot by
    its name: `--robot mbot-1`. Whoever gets **push** finds a key in their file that signs models,
    and the robot takes them. Nothing is sent anywhere by this command.

    Examples:

    - `workstation enroll mbot-1`
    - `workstation enroll mbot-1 --host mbot-1.local --host 10.0.0.7 --person max --right view`
    - `workstation enroll lab --router --host lab.local`, then `workstation enroll mbot-1 --via lab`
    - `workstation enroll --revoke max`
    - `workstation enroll --here robot.toml`: a trial with a daemon on this machine
    """
    from mbot_workstation.fleet.enrolment.membership import Enrolment

    if options.here is not None:
        options = _for_here(options, options.here)
    _check(options)
    enrolment = Enrolment()
    if options.listing or options.join is not None:
        roll = enrolment.join(options.join) if options.join else enrolment.folder.roll()
        key = enrolment.key_taken
        signs = [f"your models are signed by the key {key}, which came along"] if key else []
        return Answer(roll, [_roll_table(roll), *signs])
    begins = not enrolment.folder.has_authority
    keys_before = enrolment.keys_of(options.name)
    hand_overs = _change(options, enrolment)
    if options.here is not None:
        enrolment.place_beside(options.here, options.name)
        hand_overs = [one for one in hand_overs if not one.is_for_robot(options.name)]
    return Answer(hand_overs, _said(options, enrolment, hand_overs, begins, keys_before))


def _said(
    options: EnrollOptions,
    enrolment: "Enrolment",
    hand_overs: "Sequence[HandOver]",
    begins: bool,
    keys_before: "Sequence[str]",
) -> Iterator[str]:
    from mbot_workstation.fleet.enrolment.hand_over_words import instructions, words_on_keys

    if begins:
        yield (
            f"A fleet begins in {enrolment.folder.path}: keep that folder to yourself, and a copy "
            "of it; whoever has it can let anybody in."
        )
    roll = enrolment.folder.roll()
    for one in hand_overs:
        yield from instructions(one, roll)
    keys = enrolment.keys_of(options.name)
    if options.here is not None:
        files = " and trusted-keys.toml are" if keys else " is"
        yield (
            f"certificates are in {options.here.absolute().parent / 'tls'}, "
            f"enrolment.toml{files} beside {options.here}; restart mbot-agent, "
            f"then: workstation robots --robot {options.name}"
        )
        return
    if not hand_overs:
        yield "nothing to do: every certificate is good for 60 days and more"
    if options.revoke is not None:
        yield (
            f"{options.revoke} is off the roll; until the above is copied, its certificate is "
            "let in"
        )
    elif options.name and not options.router:
        yield from words_on_keys(keys_before, keys)
        yield f"Then: workstation robots --robot {options.name}"


def _change(options: EnrollOptions, enrolment: "Enrolment") -> "Sequence[HandOver]":
    from mbot_workstation.fleet.enrolment.hand_over_words import own_keys

    if options.revoke is not None:
        return enrolment.revoke(options.revoke)
    if options.renew:
        return enrolment.renew()
    if options.router:
        return enrolment.router(options.name, options.hosts or (), options.port)
    given = {person: options.rights or [Right.VIEW] for person in options.people or ()}
    behind = "" if options.via == "none" else options.via
    keys, _ = own_keys()
    return enrolment.robot(options.name, options.hosts or (), options.port, given, behind, keys)


def _for_here(options: EnrollOptions, configuration: Path) -> EnrollOptions:
    """What is left out follows from the configuration."""

    from mbot_workstation.fleet.enrolment.local_trial import LOOPBACK, robot_id_in

    robot_id = robot_id_in(configuration)
    if options.name not in ("", robot_id) or options.router:
        raise ConfigurationError(
            f"--here is the configuration of robot {robot_id!r}; leave ROBOT and --router out"
        )
    return replace(options, name=robot_id, hosts=options.hosts or list(LOOPBACK))


def _check(options: EnrollOptions) -> None:
    asked = (options.name, options.listing, options.revoke, options.renew, options.join)
    if sum(one not in (None, False, "") for one in asked) != 1:
        raise ConfigurationError(
            "expected one of ROBOT, --list, --revoke, --renew and --join; see `workstation enroll "
            "--help`"
        )
    of_people = bool(options.people or options.rights or options.via)
    if not options.name and (of_people or options.hosts or options.port or options.router):
        raise ConfigurationError("--host, --port, --person, --right, --via and --router need ROBOT")
    if options.router and of_people:
        raise ConfigurationError("people and --via belong to a robot, not to a router")
    if options.rights and not options.people:
        raise ConfigurationError("--right is for --person NAME: whom do you mean?")


def _roll_table(roll: "Roll") -> "Table":
    rows: list[tuple[str, ...]] = []
    for robot_id, robot in sorted(roll.robots.items()):
        via = f" by {robot.router}" if robot.router else ""
        rights = "; ".join(
            f"{person}: {', '.join(r.value for r in given)}"
            for person, given in robot.people.items()
        )
        endpoint = f"{roll.endpoint(robot_id)}{via}"
        rows.append(("robot", robot_id, endpoint, rights, f"{robot.expires:%Y-%m-%d}"))
    for person, entry in sorted(roll.people.items()):
        me = "this workstation" if person == roll.me else ""
        rows.append(("person", person, me, "", f"{entry.expires:%Y-%m-%d}"))
    for router, entry in sorted(roll.routers.items()):
        rows.append(("router", router, str(entry.endpoint), "", f"{entry.expires:%Y-%m-%d}"))
    if roll.revoked:
        rows.append(("revoked", ", ".join(roll.revoked), "", "", ""))
    return table(("", "name", "reached at", "rights", "certificate until"), rows)
