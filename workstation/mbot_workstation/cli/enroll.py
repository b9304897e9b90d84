"""`workstation enroll`: certificates and rights for robots, people and routers."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mbot_protocol.wire.keys import Right
from mbot_workstation.cli.link_options import json_option
from mbot_workstation.cli.options import argument, option, with_options

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mbot_workstation.fleet.enrolment.membership import Enrolment, HandOver
    from mbot_workstation.fleet.enrolment.roll import Roll

_OTHER = "Instead of enrolling"


@dataclass(frozen=True, slots=True, kw_only=True)
class EnrollOptions:
    """What `enroll` takes."""

    name: str = argument(
        "Its robot_id; a router's name with --router.", default="", metavar="[ROBOT]"
    )
    hosts: list[str] | None = option(
        None,
        "Name or address it is reached by, the best one first; may be repeated. "
        "ROBOT.local if never given.",
        "--host",
        metavar="NAME",
    )
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
def enroll(options: EnrollOptions) -> None:
    """Make certificates and rights for a robot and its people, and print how to copy them there.

    Whoever enrols a robot may push models to it and drive it. Others get the rights that you give:
    **view** shows status and telemetry and may stop the robot, **push** may also send models,
    **drive** may also let it run and drive it by hand. Afterwards every command finds the robot by
    its name: `--robot mbot-1`. Nothing is sent anywhere by this command.

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
    begins = not enrolment.folder.has_authority and options.join is None
    if options.listing:
        _print_roll(enrolment.folder.roll(), options.as_json)
        return
    if options.join is not None:
        _print_roll(enrolment.join(options.join), options.as_json)
        return
    keys_before = enrolment.keys_of(options.name)
    hand_overs = _change(options, enrolment)
    if begins and not options.as_json:
        print(
            f"A fleet begins in {enrolment.folder.path}: keep that folder to yourself, and a copy "
            "of it; whoever has it can let anybody in."
        )
    if options.here is not None:
        _put_here(options, options.here, enrolment, hand_overs)
        return
    _print_hand_overs(enrolment, hand_overs, options.as_json)
    if options.as_json:
        return
    if options.revoke is not None:
        print(
            f"{options.revoke} is off the roll; until the above is copied, its certificate is "
            "let in"
        )
    elif options.name and not options.router:
        print("\n".join(_words_on_keys(keys_before, enrolment.keys_of(options.name))))
        print(f"Then: workstation robots --robot {options.name}")


def _change(options: EnrollOptions, enrolment: "Enrolment") -> "Sequence[HandOver]":
    if options.revoke is not None:
        return enrolment.revoke(options.revoke)
    if options.renew:
        return enrolment.renew()
    if options.router:
        return enrolment.router(options.name, options.hosts or (), options.port)
    given = {person: options.rights or [Right.VIEW] for person in options.people or ()}
    behind = "" if options.via == "none" else options.via
    keys, _ = _own_keys()
    return enrolment.robot(options.name, options.hosts or (), options.port, given, behind, keys)


def _put_here(
    options: EnrollOptions,
    configuration: Path,
    enrolment: "Enrolment",
    hand_overs: "Sequence[HandOver]",
) -> None:
    from mbot_protocol.wire.access_rules import Kind

    folder = enrolment.place_beside(configuration, options.name)
    others = [h for h in hand_overs if (h.kind, h.name) != (Kind.ROBOT, options.name)]
    if others or options.as_json:
        _print_hand_overs(enrolment, others, options.as_json)
    if not options.as_json:
        keys = " and trusted-keys.toml are" if enrolment.keys_of(options.name) else " is"
        print(
            f"certificates are in {folder}, enrolment.toml{keys} beside {configuration}; restart "
            f"mbot-agent, then: workstation robots --robot {options.name}"
        )


def _for_here(options: EnrollOptions, configuration: Path) -> EnrollOptions:
    """What is left out follows from the configuration."""
    from dataclasses import replace

    from mbot_protocol.errors import ConfigurationError
    from mbot_workstation.fleet.enrolment.local_trial import LOOPBACK, robot_id_in

    robot_id = robot_id_in(configuration)
    if options.name not in ("", robot_id) or options.router:
        raise ConfigurationError(
            f"--here is the configuration of robot {robot_id!r}; leave ROBOT and --router out"
        )
    return replace(options, name=robot_id, hosts=options.hosts or list(LOOPBACK))


def _check(options: EnrollOptions) -> None:
    from mbot_protocol.errors import ConfigurationError

    asked = [
        bool(options.name),
        options.listing,
        options.revoke is not None,
        options.renew,
        options.join is not None,
    ]
    if sum(asked) != 1:
        raise ConfigurationError(
            "expected one of ROBOT, --list, --revoke, --renew and --join; see `workstation enroll "
            "--help`"
        )
    if not options.name and (
        options.hosts
        or options.port
        or options.people
        or options.rights
        or options.via
        or options.router
    ):
        raise ConfigurationError("--host, --port, --person, --right, --via and --router need ROBOT")
    if options.router and (options.people or options.rights or options.via):
        raise ConfigurationError("people and --via belong to a robot, not to a router")
    if options.rights and not options.people:
        raise ConfigurationError("--right is for --person NAME: whom do you mean?")


def _print_roll(roll: "Roll", as_json: bool) -> None:
    import json
    import sys

    import msgspec
    from rich.console import Console
    from rich.table import Table

    if as_json:
        print(json.dumps(msgspec.to_builtins(roll), indent=2))
        return
    table = Table(box=None, padding=(0, 2, 0, 0))
    for heading in ("", "name", "reached at", "rights", "certificate until"):
        table.add_column(heading)
    for robot_id, robot in sorted(roll.robots.items()):
        via = f" by {robot.router}" if robot.router else ""
        rights = "; ".join(
            f"{person}: {', '.join(r.value for r in given)}"
            for person, given in robot.people.items()
        )
        endpoint = str(roll.endpoint(robot_id))
        table.add_row("robot", robot_id, endpoint + via, rights, f"{robot.expires:%Y-%m-%d}")
    for person, entry in sorted(roll.people.items()):
        me = "this workstation" if person == roll.me else ""
        table.add_row("person", person, me, "", f"{entry.expires:%Y-%m-%d}")
    for router, entry in sorted(roll.routers.items()):
        table.add_row("router", router, str(entry.endpoint), "", f"{entry.expires:%Y-%m-%d}")
    if roll.revoked:
        table.add_row("revoked", ", ".join(roll.revoked), "", "", "")
    Console(width=None if sys.stdout.isatty() else 200).print(table)


def _print_hand_overs(
    enrolment: "Enrolment", hand_overs: "Sequence[HandOver]", as_json: bool
) -> None:
    import json

    if as_json:
        fields = [
            {"kind": h.kind.value, "name": h.name, "file": str(h.path), "host": h.host or None}
            for h in hand_overs
        ]
        print(json.dumps(fields, indent=2))
        return
    roll = enrolment.folder.roll()
    if not hand_overs:
        print("nothing to do: every certificate is good for 60 days and more")
    for h in hand_overs:
        print("\n".join(_instructions(h, roll)))


def _instructions(h: "HandOver", roll: "Roll") -> list[str]:
    """How to get one file to where it belongs."""
    from shlex import quote

    from mbot_protocol.wire.access_rules import Kind
    from mbot_workstation.wording import typed

    if h.kind is Kind.PERSON:
        return [
            f"person {h.name}: hand over {h.path}, by a way that nobody else can read (the key is "
            "in it);",
            f"  there: workstation enroll --join {typed(h.path.name)}",
        ]
    file = h.path.name
    copy = f"  scp {quote(str(h.path))} USER@{_bracketed(h.host)}:"
    if h.kind is Kind.ROUTER:
        expires, then = roll.routers[h.name].expires, "sudo systemctl restart zenohd"
    else:
        expires, then = roll.robots[h.name].expires, "sudo systemctl restart mbot-agent"
    return [
        f"{h.kind.value} {h.name}: certificate until {expires:%Y-%m-%d}; copy it there by",
        copy,
        f"  ssh -t USER@{h.host} 'sudo tar -xf {file} -C / && rm {file} && {then}'",
    ]


def _own_keys() -> tuple[list[str], str]:
    """The public lines of this workstation's keys; none, and why, if they can't be read."""
    from mbot_protocol.errors import ConfigurationError
    from mbot_workstation.fleet.models.key_folder import KeyFolder

    try:
        return [key.line for key in KeyFolder().public_keys()], ""
    except ConfigurationError as error:
        return [], str(error)


def _words_on_keys(before: "Sequence[str]", sent: "Sequence[str]") -> list[str]:
    """Whose models the robot takes once it has its file, and what to do if it is too old for it."""
    from mbot_workstation.fleet.models.trusting_configuration import by_hand

    own, problem = _own_keys()
    words = [f"Your keys can't be read, so none is added: {problem}"] if problem else []
    if not own and not problem:
        words = [
            "It takes models only from keys it trusts, and you have none: `workstation keys new` "
            "makes one;",
            "  then `workstation enroll` again, and it goes along",
        ]
    if not sent:
        return words
    words.append(
        f"It takes models signed by {_names(sent)} from then on: trusted-keys.toml goes along"
    )
    if dropped := [line for line in before if line not in sent]:
        words.append(f"  and no longer by {_names(dropped)}, unless its config.toml says so")
    words.append("  If its mbot-agent is older and ignores that file,")
    return words + [f"  {line}" for line in by_hand(sent)]


def _names(lines: "Sequence[str]") -> str:
    return ", ".join(line.partition(" ")[2] for line in lines)


def _bracketed(host: str) -> str:
    return f"[{host}]" if ":" in host else host
