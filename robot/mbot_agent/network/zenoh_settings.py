"""Zenoh's configuration for one robot: no scouting, bounded messages and sessions, default deny."""

# pyright: strict, reportUnknownMemberType=false
# (zenoh's stubs leave out some return types.)

import json

import zenoh

from mbot_agent.configuration import Configuration, Network
from mbot_protocol.wire.access_rules import LONGEST_BLOCK_US, Json, request_limits, robot_access

LARGEST_MESSAGE_BYTES = 128 * 1024
"""A message is put together from fragments up to this size, for each of 16 priorities of each
session; the largest anybody needs is a chunk of a model, 64 KiB."""

MOST_SESSIONS = 32
"""Those who have to go (session_guard) need a place until they are shown out."""

MOST_PENDING = 8
"""Handshakes of Zenoh under way at a time."""

ACCEPT_TIMEOUT_MS = 5000

TLS_HANDSHAKE_TIMEOUT_MS = 3000
"""Whoever connects and says nothing holds a descriptor for this long; Zenoh's default is 10 s."""

LEASE_MS = 2000
"""Either side forgets the other after so much silence; Zenoh's default is 10 s."""


def zenoh_configuration(configuration: Configuration) -> zenoh.Config:
    """Everything this robot's session needs."""
    network = configuration.network
    settings = _common(network) | _tls(network)
    settings["access_control"] = robot_access(
        configuration.robot_id,
        configuration.access.people,
        configuration.access.routers,
        loopback=_speaks(network, "tcp"),
    )
    settings["low_pass_filter"] = request_limits(configuration.robot_id)
    config = zenoh.Config()
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


def _common(network: Network) -> Json:
    return {
        "mode": "peer",
        "listen/endpoints": [_impatient(endpoint) for endpoint in network.listen],
        "listen/exit_on_failure": True,
        "connect/endpoints": list(network.connect),
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/unicast/max_sessions": MOST_SESSIONS,
        "transport/unicast/accept_pending": MOST_PENDING,
        "transport/unicast/accept_timeout": ACCEPT_TIMEOUT_MS,
        "transport/link/rx/max_message_size": LARGEST_MESSAGE_BYTES,
        "transport/link/tx/lease": LEASE_MS,
        "transport/link/tx/queue/congestion_control/block/wait_before_close": LONGEST_BLOCK_US,
        "transport/link/protocols": [p for p in ("tcp", "tls") if _speaks(network, p)],
        "transport/shared_memory/enabled": False,
    }


def _tls(network: Network) -> Json:
    if network.tls is None:
        return {}
    files = {
        "root_ca_certificate": network.tls.ca,
        "listen_certificate": network.tls.certificate,
        "listen_private_key": network.tls.key,
        "connect_certificate": network.tls.certificate,
        "connect_private_key": network.tls.key,
        "enable_mtls": True,
        "verify_name_on_connect": True,
        "close_link_on_expiration": True,
    }
    return {f"transport/link/tls/{name}": value for name, value in files.items()}


def _speaks(network: Network, protocol: str) -> bool:
    endpoints = (*network.listen, *network.connect)
    return any(endpoint.startswith(f"{protocol}/") for endpoint in endpoints)


def _impatient(endpoint: str) -> str:
    if not endpoint.startswith("tls/") or "#" in endpoint:
        return endpoint
    return f"{endpoint}#tls_handshake_timeout_ms={TLS_HANDSHAKE_TIMEOUT_MS}"
