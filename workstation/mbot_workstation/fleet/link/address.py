"""A robot's address as a person types it -> the Zenoh endpoint to connect to."""

import re
from dataclasses import dataclass

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.wire.keys import DEFAULT_ENDPOINT, DEFAULT_PORT
from mbot_workstation.fleet.link.security import LinkSecurity

ADDRESS_VARIABLE = "MBOT_ROBOT"
"""Environment variable with the address to use when none is given."""

PROTOCOLS = ("tcp", "tls")

_HOST_AND_PORT = re.compile(r"(?P<host>\[[0-9A-Fa-f:.]+\]|[^\[\]:/\s#?;]+)(:(?P<port>\d{1,5}))?")


@dataclass(frozen=True, slots=True)
class Endpoint:
    """Where a robot's daemon, or a router in front of a fleet, listens.

    Attributes:
        protocol: "tcp" or "tls".
        host: name or address, an IPv6 address without its brackets.
        port: 1 to 65535.

    """

    protocol: str
    host: str
    port: int

    def __str__(self) -> str:
        """The form Zenoh takes; `parse_address` reads it back."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{self.protocol}/{host}:{self.port}"

    @property
    def is_loopback(self) -> bool:
        """Whether the address is this machine's own, as with an SSH tunnel."""
        return self.host in ("localhost", "::1") or self.host.startswith("127.")


def parse_address(text: str, *, secured: bool = False) -> Endpoint:
    """Read `HOST`, `HOST:PORT`, `tcp/HOST:PORT` or `tls/HOST:PORT`.

    Args:
        text: the address; empty means the default, this machine.
        secured: whether certificates are at hand; an address without a protocol is then `tls`.

    Raises:
        ConfigurationError: the text is no such address.

    """
    protocol, slash, rest = (text.strip() or DEFAULT_ENDPOINT).rpartition("/")
    if not slash:
        protocol = "tls" if secured else "tcp"
    elif secured and not text.strip():
        protocol = "tls"
    if protocol not in PROTOCOLS:
        raise _bad_address(text, f"protocol {protocol!r} is neither 'tcp' nor 'tls'")
    match = _HOST_AND_PORT.fullmatch(rest)
    if match is None:
        advice = "put an IPv6 address in brackets" if rest.count(":") > 1 else "no host and port"
        raise _bad_address(text, advice)
    port = int(match["port"] or DEFAULT_PORT)
    if not 1 <= port <= 65535:
        raise _bad_address(text, f"port {port} is not in 1 to 65535")
    return Endpoint(protocol, match["host"].strip("[]"), port)


def _bad_address(text: str, what: str) -> ConfigurationError:
    return ConfigurationError(
        f"robot address {text!r}: {what}; expected HOST, HOST:PORT, tcp/HOST:PORT or "
        "tls/HOST:PORT, such as mbot-1.local:7447"
    )


@dataclass(frozen=True, slots=True)
class Destination:
    """A robot, or an address that may have some.

    Attributes:
        endpoint: where to connect to.
        robot_id: which robot; None: whoever is there.
        security: certificates for a `tls/` endpoint.

    """

    endpoint: Endpoint
    robot_id: str | None = None
    security: LinkSecurity | None = None
