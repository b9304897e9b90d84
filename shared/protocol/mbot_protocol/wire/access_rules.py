"""Who may talk to a robot: Zenoh's access control, made from the table of keys.

Whatever no rule allows is dropped without a word, in either direction. People, robots and routers
are told apart by the common names in their certificates, which say what each one is: a robot's
certificate is nobody's licence to drive.
"""

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from enum import Enum
from typing import Any

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.wire.keys import ALIVE, DOORS, PRESENCE, TOPICS, Flow, Right

Json = dict[str, Any]
"""A part of Zenoh's configuration, as `Config.insert_json5` takes it."""

LONGEST_BLOCK_US = 200_000
"""Who does not read for so long, while something waits for them, is given up by robots and routers:
whatever else goes out is held up meanwhile, a STOP on its way through a router too. Zenoh's default
is 5 s (transport/link/tx/queue/congestion_control/block/wait_before_close)."""


class Kind(Enum):
    """What a certificate belongs to."""

    PERSON = "person"
    ROBOT = "robot"
    ROUTER = "router"


_NAME = re.compile(r"[a-z0-9][a-z0-9_-]{0,31}")


def check_name(name: str) -> str:
    """Return the name of a person or router if it can stand in a certificate and a file name.

    Raises:
        ConfigurationError: it is not 1 to 32 of a-z, 0-9, `-`, `_`, beginning with a letter or
            digit.

    """
    if not _NAME.fullmatch(name):
        raise ConfigurationError(
            f"name is {name!r}, expected 1 to 32 of a-z, 0-9, '-' and '_', such as 'rosa'"
        )
    return name


def common_name(kind: Kind, name: str) -> str:
    """What stands in the certificate: "person:rosa"."""
    return f"{kind.value}:{name}"


def split_common_name(text: str) -> tuple[Kind, str] | None:
    """Kind and name; None if the certificate is not one of ours."""
    kind, _, name = text.partition(":")
    if kind not in {k.value for k in Kind} or not _NAME.fullmatch(name):
        return None
    return Kind(kind), name


def with_view(rights: Iterable[Right]) -> frozenset[Right]:
    """The rights and what comes with them: whoever may do anything may look, and stop."""
    given = frozenset(rights)
    return given | {Right.VIEW} if given else given


People = Mapping[str, Collection[Right]]
"""Rights by person."""


def robot_access(
    robot_id: str, people: People, routers: Collection[str], *, loopback: bool
) -> Json:
    """Access control of one robot.

    Args:
        robot_id: whose keys; no other key is let through.
        people: by the names in their certificates.
        routers: names of routers; a router may do everything, for it checks people itself.
        loopback: whether plain TCP may do everything. It comes from this machine only: whoever
            has logged in here, by SSH for instance.

    """
    trusted: list[Json] = []
    if routers:
        names = [common_name(Kind.ROUTER, name) for name in routers]
        trusted.append({"id": "routers", "cert_common_names": names})
    if loopback:
        trusted.append({"id": "loopback", "link_protocols": ["tcp"]})
    access = _Access()
    for right in Right:
        rules = _rules(robot_id, right, towards_person=True)
        access.allow(f"{robot_id} {right.value}", rules, [*_subjects(people, right), *trusted])
    return access.to_json()


def router_access(fleet: Mapping[str, People]) -> Json:
    """Access control of a router: robots keep to their own keys, people to their rights.

    Args:
        fleet: the people of each robot, by robot.

    """
    access = _Access()
    for robot_id, people in fleet.items():
        robot: Json = {"id": robot_id, "cert_common_names": [common_name(Kind.ROBOT, robot_id)]}
        for right in Right:
            inward = _rules(robot_id, right, towards_person=False)
            access.allow(f"{robot_id} serves {right.value}", inward, [robot])
            outward = _rules(robot_id, right, towards_person=True)
            subjects = _subjects(people, right, of=robot_id)
            access.allow(f"{robot_id} {right.value}", outward, subjects)
    return access.to_json()


def request_limits(robot_id: str) -> list[Json]:
    """Zenoh's filter of too large requests; `*` for all robots, as a router needs it."""
    queries = [topic for topic in TOPICS if topic.flow is Flow.QUERY]
    return [
        {
            "id": f"at most {size_bytes} bytes",
            "messages": ["query"],
            "flows": ["ingress"],
            "key_exprs": [t.key(robot_id) for t in queries if t.largest_bytes == size_bytes],
            "size_limit": size_bytes,
        }
        for size_bytes in sorted({topic.largest_bytes for topic in queries})
    ]


class _Access:
    """Collects rules, the subjects they are for, and who goes with what."""

    def __init__(self) -> None:
        self._rules: list[Json] = []
        self._subjects: dict[str, Json] = {}
        self._policies: list[Json] = []

    def allow(self, name: str, rules: Sequence[Json], subjects: Sequence[Json]) -> None:
        """Allow each subject what the rules say; nothing happens without subjects."""
        if not subjects:
            return
        named = [rule | {"id": f"{name} {index}"} for index, rule in enumerate(rules)]
        self._rules += named
        self._subjects |= {str(subject["id"]): subject for subject in subjects}
        self._policies.append(
            {
                "id": name,
                "rules": [rule["id"] for rule in named],
                "subjects": [subject["id"] for subject in subjects],
            }
        )

    def to_json(self) -> Json:
        return {
            "enabled": True,
            "default_permission": "deny",
            "rules": self._rules,
            "subjects": list(self._subjects.values()),
            "policies": self._policies,
        }


def _subjects(people: People, right: Right, of: str = "") -> list[Json]:
    """Those who have a right, as one subject; Zenoh takes no empty ones."""
    names = [
        common_name(Kind.PERSON, name)
        for name, rights in people.items()
        if right in with_view(rights)
    ]
    return [{"id": f"{of} {right.value}", "cert_common_names": names}] if names else []


_Side = tuple[tuple[str, ...], list[str]]
"""Messages of one direction, and their keys."""


def _rules(robot_id: str, right: Right, *, towards_person: bool) -> list[Json]:
    """What one right lets through; seen from the robot, unless `towards_person` is false."""
    topics = [topic for topic in TOPICS if topic.right is right and topic is not PRESENCE]
    keys = {flow: [t.key(robot_id) for t in topics if t.flow is flow] for flow in Flow}
    look: _Side = (("liveliness_query", "declare_liveliness_subscriber"), _searches(robot_id))
    from_person: list[_Side] = [
        (("query",), keys[Flow.QUERY]),
        (("declare_subscriber",), keys[Flow.PUBLISH]),
    ]
    from_robot: list[_Side] = [
        (("reply", "declare_queryable"), keys[Flow.QUERY]),
        (("put",), keys[Flow.PUBLISH]),
        (("liveliness_token",), keys[Flow.LIVELINESS]),
    ]
    if right is Right.VIEW:
        from_person += [look, (("liveliness_token",), [PRESENCE.key(robot_id)])]
        from_robot.append((look[0], [PRESENCE.key(robot_id)]))
    inward, outward = ("ingress", "egress") if towards_person else ("egress", "ingress")
    return [
        {"permission": "allow", "messages": list(messages), "flows": [flow], "key_exprs": exprs}
        for flow, sides in ((inward, from_person), (outward, from_robot))
        for messages, exprs in sides
        if exprs
    ]


def _searches(robot_id: str) -> list[str]:
    """Where a workstation looks for tokens; what it finds is only what it may see."""
    doors = DOORS[Right.VIEW].key(robot_id).rpartition("/")[0]
    return [ALIVE.key("*"), ALIVE.key(robot_id), f"{doors}/*"]
