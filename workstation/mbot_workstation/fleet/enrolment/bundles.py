"""What is handed over: to robots and routers a tar file unpacked at /, to people one to join by.

Only text and bytes here; the files' owners and modes are those they shall have over there.
"""

import io
import json
import tarfile
from collections.abc import Iterable
from dataclasses import dataclass

import msgspec
import tomli_w
from msgspec import UNSET

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.wire.access_rules import LONGEST_BLOCK_US, Kind, request_limits, router_access
from mbot_protocol.wire.keys import STOP
from mbot_workstation.fleet.enrolment.certificates import Identity, check_issued
from mbot_workstation.fleet.enrolment.roll import (
    ROLL_FILE,
    EnrolledPerson,
    Roll,
    decode_roll,
    encode_roll,
)

ROBOT_FOLDER = "etc/mbot-agent"
ROUTER_FOLDER = "etc/zenohd"
TRUSTED_KEYS_FILE = "trusted-keys.toml"

LEASE_MS = 2000
"""As the robot's: whoever falls silent is forgotten after 2 s on each hop."""

MOST_ROUTER_SESSIONS = 256

MOST_STOPS_HZ = 50.0
"""Of one link to a router, to one robot. A STOP that comes within 20 ms of another one changes
nothing: a `run` between them would have to name the first one's count, which nobody knows before
its reply. Whoever waits for the board's word asks again after 50 ms (remote_control)."""

LARGEST_ROUTED_BYTES = 1 << 20

LARGEST_JOIN_FILE_BYTES = 1 << 20
"""A few certificates and a list of robots are some kilobytes."""

_ENROLMENT_HEAD = """\
# Written by `workstation enroll`; takes the place of [network] and [access] in config.toml.
# Do not edit it: enrol again and copy it again.

"""

_TRUSTED_KEYS_HEAD = """\
# Written by `workstation enroll`: whose models this robot takes, besides those in config.toml.
# Do not edit it: enrol again and copy it again.

"""

_ROUTER_HEAD = """\
// For zenohd, a Zenoh router; written by `workstation enroll`. Robots keep to their keys, people
// to their rights; everything else is dropped. Do not edit it: enrol again.
"""


@dataclass(frozen=True, slots=True)
class _File:
    """A file over there: below / for robots and routers."""

    name: str
    data: bytes
    mode: int = 0o644
    group: str = "root"


def robot_bundle(roll: Roll, robot_id: str, robot: Identity, authority_pem: bytes) -> bytes:
    """The tar file for a robot: certificates, the configuration of network and people, and the
    keys whose models it takes.
    """
    tls = f"{ROBOT_FOLDER}/tls"
    files = [
        _File(f"{tls}/ca.pem", authority_pem),
        _File(f"{tls}/robot.pem", robot.certificate_pem),
        _File(f"{tls}/robot.key", robot.key_pem, 0o640, "mbot-agent"),
        _File(f"{ROBOT_FOLDER}/enrolment.toml", enrolment_toml(roll, robot_id).encode()),
    ]
    if roll.robots[robot_id].keys is not UNSET:
        files.append(
            _File(
                f"{ROBOT_FOLDER}/{TRUSTED_KEYS_FILE}",
                trusted_keys_toml(roll.keys_of(robot_id)).encode(),
            )
        )
    return _tar(files)


def trusted_keys_toml(keys: Iterable[str]) -> str:
    """The robot's trusted-keys.toml, for the public lines of keys."""
    return _TRUSTED_KEYS_HEAD + tomli_w.dumps({"keys": list(keys)})


def enrolment_toml(
    roll: Roll, robot_id: str, folder: str = f"/{ROBOT_FOLDER}/tls", listen: str = "0.0.0.0"
) -> str:
    """The robot's enrolment.toml, for certificates in a folder over there."""
    robot = roll.robots[robot_id]
    router = roll.routers.get(robot.router)
    document = {
        "robot_id": robot_id,
        "network": {
            "listen": [f"tls/{listen}:{robot.port}"],
            "connect": [] if router is None else [str(router.endpoint)],
            "tls": {
                "ca": f"{folder}/ca.pem",
                "certificate": f"{folder}/robot.pem",
                "key": f"{folder}/robot.key",
            },
        },
        "access": {
            "routers": [] if router is None else [robot.router],
            "people": {
                name: [right.value for right in rights] for name, rights in robot.people.items()
            },
        },
    }
    return _ENROLMENT_HEAD + tomli_w.dumps(document)


def router_bundle(roll: Roll, name: str, router: Identity, authority_pem: bytes) -> bytes:
    """The tar file for a router: certificates and zenohd's configuration."""
    return _tar(
        [
            _File(f"{ROUTER_FOLDER}/ca.pem", authority_pem),
            _File(f"{ROUTER_FOLDER}/router.pem", router.certificate_pem),
            _File(f"{ROUTER_FOLDER}/router.key", router.key_pem, 0o640, "zenohd"),
            _File(f"{ROUTER_FOLDER}/zenohd.json5", zenohd_json5(roll, name).encode()),
        ]
    )


def zenohd_json5(roll: Roll, name: str, folder: str = f"/{ROUTER_FOLDER}") -> str:
    """The router's configuration, for certificates in a folder over there."""
    behind = {robot_id: r for robot_id, r in roll.robots.items() if r.router == name}
    settings = {
        "mode": "router",
        "listen": {"endpoints": [f"tls/0.0.0.0:{roll.routers[name].port}"]},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "transport": {
            "unicast": {"max_sessions": MOST_ROUTER_SESSIONS, "accept_pending": 16},
            "shared_memory": {"enabled": False},
            "link": {
                "protocols": ["tls"],
                "tx": {
                    "lease": LEASE_MS,
                    "queue": {
                        "congestion_control": {"block": {"wait_before_close": LONGEST_BLOCK_US}}
                    },
                },
                "rx": {"max_message_size": LARGEST_ROUTED_BYTES},
                "tls": {
                    "root_ca_certificate": f"{folder}/ca.pem",
                    "listen_certificate": f"{folder}/router.pem",
                    "listen_private_key": f"{folder}/router.key",
                    "enable_mtls": True,
                    "close_link_on_expiration": True,
                },
            },
        },
        "access_control": router_access({robot_id: r.people for robot_id, r in behind.items()}),
        "low_pass_filter": request_limits("*"),
        # A robot sees one link for all who come through a router, and can show nobody out.
        "downsampling": [
            {
                "id": f"STOPs of one link to {robot_id}",
                "messages": ["query"],
                "flows": ["ingress"],
                "rules": [{"key_expr": STOP.key(robot_id), "freq": MOST_STOPS_HZ}],
            }
            for robot_id in behind
        ],
    }
    return _ROUTER_HEAD + json.dumps(settings, indent=2) + "\n"


def person_bundle(
    roll: Roll, name: str, person: Identity, authority_pem: bytes, signing_pem: bytes = b""
) -> bytes:
    """The tar file for a person: a fleet's folder with no more in it than that person needs, and
    the private key that signs their models, if one was made for them.
    """
    robots = {
        robot_id: msgspec.structs.replace(
            robot, people={name: robot.people[name]}, keys=msgspec.UNSET
        )
        for robot_id, robot in roll.robots.items()
        if name in robot.people
    }
    routers = {r.router: roll.routers[r.router] for r in robots.values() if r.router}
    me = EnrolledPerson(roll.people[name].expires)
    theirs = Roll(me=name, robots=robots, people={name: me}, routers=routers)
    folder = f"{Kind.PERSON.value}s"
    return _tar(
        [
            _File(ROLL_FILE, encode_roll(theirs), 0o600),
            _File("authority.pem", authority_pem, 0o600),
            _File(f"{folder}/{name}.pem", person.certificate_pem, 0o600),
            _File(f"{folder}/{name}.key", person.key_pem, 0o600),
            *([_File(f"{folder}/{name}.sign", signing_pem, 0o600)] if signing_pem else []),
        ]
    )


def read_person_bundle(data: bytes, origin: str) -> tuple[Roll, Identity, bytes, bytes]:
    """What a person's file holds: the roll, the person's identity, the authority's certificate, and
    the private key that signs models, empty if none was made.

    Raises:
        ConfigurationError: it is no such file, or has more in it than it should; `origin` names it.

    """
    files = _untar(data, origin)
    try:
        roll = decode_roll(files.pop(ROLL_FILE), origin)
        authority_pem = files.pop("authority.pem")
        stem = f"{Kind.PERSON.value}s/{roll.me}"
        identity = Identity(files.pop(f"{stem}.pem"), files.pop(f"{stem}.key"))
    except KeyError as error:
        raise ConfigurationError(
            f"{origin} has no {error.args[0]}: is it the file that `workstation enroll` made for "
            "a person?"
        ) from None
    signing_pem = files.pop(f"{stem}.sign", b"")
    if files:
        raise ConfigurationError(f"{origin} has {min(files)!r} in it, which does not belong there")
    check_issued(identity, authority_pem, origin)
    return roll, identity, authority_pem, signing_pem


def _tar(files: Iterable[_File]) -> bytes:
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w", format=tarfile.USTAR_FORMAT) as tar:
        for file in files:
            entry = tarfile.TarInfo(file.name)
            entry.size, entry.mode = len(file.data), file.mode
            entry.uname, entry.gname = "root", file.group
            tar.addfile(entry, io.BytesIO(file.data))
    return buffer.getvalue()


def _untar(data: bytes, origin: str) -> dict[str, bytes]:
    """The regular files of a tar file, without touching the disk."""
    if len(data) > LARGEST_JOIN_FILE_BYTES:
        raise ConfigurationError(f"{origin} has {len(data)} bytes, too many for a person's file")
    files: dict[str, bytes] = {}
    try:
        with tarfile.open(fileobj=io.BytesIO(data), mode="r:") as tar:
            for entry in tar:
                content = tar.extractfile(entry) if entry.isreg() else None
                if content is not None:
                    files[entry.name] = content.read()
    except (tarfile.TarError, EOFError, ValueError, OverflowError) as error:
        raise ConfigurationError(f"{origin} is not a tar file: {error}") from None
    return files
