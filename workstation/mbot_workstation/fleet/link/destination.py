"""Where to connect to, and as whom."""

from dataclasses import dataclass

from mbot_workstation.fleet.link.address import Endpoint
from mbot_workstation.fleet.link.security import LinkSecurity


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
