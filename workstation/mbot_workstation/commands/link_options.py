"""The options that every command has that talks to a robot."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mbot_workstation.link.address import ADDRESS_VARIABLE
from mbot_workstation.link.security import link_security

if TYPE_CHECKING:
    from mbot_workstation.link.robot_link import RobotLink

_LINK = "Link to the robot"
_ADDRESS_HELP = (
    "The name of an enrolled robot, or HOST, HOST:PORT, tcp/HOST:PORT, tls/HOST:PORT; this machine "
    "if not given."
)
_ADDRESSES_HELP = (
    "As for the other commands, and several times; all enrolled robots if not given, or this "
    "machine if there are none."
)

RobotOption = Annotated[
    str,
    typer.Option(
        "--robot",
        metavar="ROBOT",
        envvar=ADDRESS_VARIABLE,
        help=_ADDRESS_HELP,
        rich_help_panel=_LINK,
    ),
]
RobotsOption = Annotated[
    list[str] | None,
    typer.Option(
        "--robot",
        metavar="ROBOT",
        envvar=ADDRESS_VARIABLE,
        help=_ADDRESSES_HELP,
        rich_help_panel=_LINK,
    ),
]
IdOption = Annotated[
    str | None,
    typer.Option(
        "--id",
        metavar="ROBOT",
        help="Which robot, where several are alive behind one address.",
        rich_help_panel=_LINK,
    ),
]
CaOption = Annotated[
    Path | None,
    typer.Option(
        "--ca",
        metavar="FILE",
        envvar="MBOT_CA",
        help="Authority that signed the robot's certificate, for tls/.",
        rich_help_panel=_LINK,
    ),
]
CertificateOption = Annotated[
    Path | None,
    typer.Option(
        "--certificate",
        metavar="FILE",
        envvar="MBOT_CERTIFICATE",
        help="This workstation's certificate, for tls/.",
        rich_help_panel=_LINK,
    ),
]
KeyOption = Annotated[
    Path | None,
    typer.Option(
        "--key",
        metavar="FILE",
        envvar="MBOT_KEY",
        help="The private key of --certificate.",
        rich_help_panel=_LINK,
    ),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON, for scripts.")]


def robot_link(
    robot: str,
    robot_id: str | None,
    ca: Path | None,
    certificate: Path | None,
    key: Path | None,
) -> "RobotLink":
    """The link that these options ask for, to be opened by `with`.

    Raises:
        ConfigurationError: an address, an identifier or a file is unusable.

    """
    from mbot_workstation.enrolment.enrolled_robots import find_destination
    from mbot_workstation.link.robot_link import RobotLink

    found = find_destination(robot, robot_id, link_security(ca, certificate, key))
    return RobotLink(str(found.endpoint), found.robot_id, found.security)
