"""What a person has to do once somebody is enrolled: where files go, whose models are taken."""

from collections.abc import Iterator, Sequence
from shlex import quote

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.wire.access_rules import Kind
from mbot_workstation.fleet.enrolment.membership import HandOver
from mbot_workstation.fleet.enrolment.roll import Roll
from mbot_workstation.fleet.models.key_folder import KeyFolder
from mbot_workstation.fleet.models.trusting_configuration import by_hand
from mbot_workstation.wording import typed


def instructions(h: HandOver, roll: Roll) -> list[str]:
    """How to get one file to where it belongs."""
    if h.kind is Kind.PERSON:
        return [
            f"person {h.name}: hand over {h.path}, by a way that nobody else can read (the key is "
            "in it);",
            f"  there: workstation enroll --join {typed(h.path.name)}",
        ]
    file, host = h.path.name, h.host or ""
    router = h.kind is Kind.ROUTER
    expires = (roll.routers if router else roll.robots)[h.name].expires
    then = f"sudo systemctl restart {'zenohd' if router else 'mbot-agent'}"
    to = f"[{host}]" if ":" in host else host
    return [
        f"{h.kind.value} {h.name}: certificate until {expires:%Y-%m-%d}; copy it there by",
        f"  scp {quote(str(h.path))} USER@{to}:",
        f"  ssh -t USER@{host} 'sudo tar -xf {file} -C / && rm {file} && {then}'",
    ]


def own_keys() -> tuple[list[str], str]:
    """The public lines of this workstation's keys; none, and why, if they can't be read."""
    try:
        return [key.line for key in KeyFolder().public_keys()], ""
    except ConfigurationError as error:
        return [], str(error)


def words_on_keys(before: Sequence[str], sent: Sequence[str]) -> Iterator[str]:
    """Whose models the robot takes once it has its file, and what to do if it is too old for it."""
    own, problem = own_keys()
    if problem:
        yield f"Your keys can't be read, so none is added: {problem}"
    elif not own:
        yield (
            "It takes models only from keys it trusts, and you have none: `workstation keys new` "
            "makes one;"
        )
        yield "  then `workstation enroll` again, and it goes along"
    if not sent:
        return
    yield f"It takes models signed by {_names(sent)} from then on: trusted-keys.toml goes along"
    if dropped := [line for line in before if line not in sent]:
        yield f"  and no longer by {_names(dropped)}, unless its config.toml says so"
    yield "  If its mbot-agent is older and ignores that file,"
    yield from (f"  {line}" for line in by_hand(sent))


def _names(lines: Sequence[str]) -> str:
    return ", ".join(line.partition(" ")[2] for line in lines)
