"""What this workstation may do with a robot, and saying so: Zenoh itself denies without a word."""

import zenoh

from mbot_protocol.errors import RefusedError
from mbot_protocol.wire.access_rules import Kind, split_common_name
from mbot_protocol.wire.keys import DOORS, Right
from mbot_workstation.fleet.link.security import LinkSecurity, owner_name

_DEEDS = {
    Right.VIEW: "see {robot}",
    Right.PUSH: "send models to {robot}, see those it keeps or change its recordings",
    Right.DRIVE: "drive {robot}",
}


def rights_at(session: zenoh.Session, robot_id: str, timeout_s: float) -> frozenset[Right]:
    """The rights that a robot shows to this workstation; none if it shows itself not at all."""
    any_door = DOORS[Right.VIEW].key(robot_id).rpartition("/")[0] + "/*"
    shown = {
        str(reply.ok.key_expr)
        for reply in session.liveliness().get(any_door, timeout=timeout_s)
        if reply.ok is not None
    }
    return frozenset(right for right in Right if DOORS[right].key(robot_id) in shown)


def person(security: LinkSecurity | None) -> str:
    """Whose certificate is shown, as its owner is called; empty without one."""
    if security is None or security.certificate is None:
        return ""
    owner = owner_name(security.certificate.read_bytes())
    match split_common_name(owner):
        case (Kind.PERSON, name):
            return name
        case (kind, name):
            return f"{kind.value} {name}"
        case _:
            return owner


def refusal(who: str, robot_id: str, right: Right, has: frozenset[Right]) -> RefusedError:
    """The error for something that `who` may not do, with the way to get the right."""
    deed = _DEEDS[right].format(robot=robot_id)
    only = ", ".join(r.value for r in Right if r in has)
    return RefusedError(
        f"{who or 'this workstation'} has no right to {deed} (only: {only}); ask whoever enrolled "
        f"it for `workstation enroll {robot_id} --person {who or 'NAME'} --right {right.value}`"
    )
