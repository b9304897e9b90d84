"""A Zenoh session to one endpoint, and who is alive behind it.

No scouting: a workstation talks to the endpoint it was given and nothing else. Robots that find
each other by multicast have been seen to obey each other's commands.
"""

import json

import zenoh

from mbot_protocol.errors import ConfigurationError, MbotError, UnreachableError
from mbot_protocol.wire.connected_sockets import let_none_linger
from mbot_protocol.wire.keys import ALIVE, check_robot_id, robot_id_of
from mbot_workstation.fleet.link.address import Endpoint
from mbot_workstation.fleet.link.diagnosis import why_no_session, why_unreachable
from mbot_workstation.fleet.link.security import LinkSecurity

LARGEST_MESSAGE_BYTES = 4 << 20
"""Robots send pictures of some kilobytes; no more than this of anything is ever kept."""

CONNECT_TIMEOUT_S = 4.0
"""Enough for a slow Wi-Fi's name look-up and TLS handshake; a person waits no longer."""


def open_session(
    endpoint: Endpoint, security: LinkSecurity | None, timeout_s: float = CONNECT_TIMEOUT_S
) -> zenoh.Session:
    """Connect; the caller closes the session, best as a context manager.

    Raises:
        ConfigurationError: certificates without `tls/`, or the other way round.
        UnreachableError: no session, with the reason as far as it can be found.

    """
    if endpoint.protocol == "tls" and security is None:
        raise ConfigurationError(f"{endpoint} needs --ca, the authority that signed the robot")
    if endpoint.protocol != "tls" and security is not None:
        raise ConfigurationError(f"certificates are given, but {endpoint} is not tls/HOST:PORT")
    # Knocking first tells a refused connection at once; Zenoh would retry until the time is up.
    reason = why_unreachable(endpoint, timeout_s)
    if reason is None:
        try:
            session = zenoh.open(_configuration(endpoint, security, timeout_s))
            # One robot that is gone must not keep what is said to another waiting.
            session.info.declare_link_events_listener(_on_link, history=True)
            return session
        except zenoh.ZError:
            reason = why_no_session(endpoint, security, timeout_s)
    raise UnreachableError(f"no connection to {endpoint}: {reason}")


def _on_link(_: zenoh.LinkEvent) -> None:
    let_none_linger()


def alive_robots(session: zenoh.Session, timeout_s: float = CONNECT_TIMEOUT_S) -> list[str]:
    """Identifiers of the robots whose daemon is connected, in order."""
    found: set[str] = set()
    for reply in session.liveliness().get(ALIVE.key("*"), timeout=timeout_s):
        if reply.ok is not None:
            try:
                found.add(check_robot_id(robot_id_of(str(reply.ok.key_expr))))
            except MbotError:
                continue  # not one of ours: no daemon takes such a name
    return sorted(found)


def _configuration(
    endpoint: Endpoint, security: LinkSecurity | None, timeout_s: float
) -> zenoh.Config:
    settings: dict[str, object] = {
        "mode": "client",
        "connect/endpoints": [str(endpoint)],
        "connect/timeout_ms": round(timeout_s * 1000),
        "connect/exit_on_failure": True,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/shared_memory/enabled": False,
        "transport/link/rx/max_message_size": LARGEST_MESSAGE_BYTES,
    }
    if security is not None:
        tls = "transport/link/tls"
        settings[f"{tls}/root_ca_certificate"] = str(security.ca)
        settings[f"{tls}/verify_name_on_connect"] = True
        if security.certificate is not None:
            settings[f"{tls}/enable_mtls"] = True
            settings[f"{tls}/connect_certificate"] = str(security.certificate)
            settings[f"{tls}/connect_private_key"] = str(security.key)
    configuration = zenoh.Config()
    for key, value in settings.items():
        configuration.insert_json5(key, json.dumps(value))
    return configuration
