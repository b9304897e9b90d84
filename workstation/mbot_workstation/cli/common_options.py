"""Options that several commands have: which robot, how to reach it, what to simulate."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.cli.options import option
from mbot_workstation.fleet.link.address import ADDRESS_VARIABLE
from mbot_workstation.fleet.link.security import LinkSecurity, link_security

if TYPE_CHECKING:
    from mbot_workstation.fleet.link.robot_link import RobotLink
    from mbot_workstation.tasks.lesson import Lesson

DEFAULT_CALIBRATION = Path("calibration/mbot-1")

_LINK = "Link to the robot"
_CA_HELP = "Authority that signed the robot's certificate, for tls/."
_CERTIFICATE_HELP = "This workstation's certificate, for tls/."
_KEY_HELP = "The private key of --certificate."


def json_option() -> Any:
    """--json."""
    return option(False, "Print JSON, for scripts.", "--json")


def robots_option() -> Any:
    """--robot for commands that look at several."""
    return option(
        None,
        "As for the other commands, and several times; all enrolled robots if not given, or this "
        "machine if there are none.",
        "--robot",
        panel=_LINK,
        metavar="ROBOT",
        envvar=ADDRESS_VARIABLE,
    )


def hosts_option() -> Any:
    """--host for commands that enrol a robot."""
    return option(
        None,
        "Name or address it is reached by, the best one first; may be repeated. "
        "ROBOT.local if never given.",
        "--host",
        metavar="NAME",
    )


def calibration_option() -> Any:
    """--calibration for commands that simulate a robot."""
    return option(
        None,
        "One robot's calibration, such as calibration/mbot-1: simulate that robot, in its light "
        "and, if the folder has any, in its rooms. What it lacks stays nominal.",
        "--calibration",
        metavar="FOLDER",
    )


def object_option(
    words: str = "What there is to fetch in place of the red cube: shape, size, colour; several "
    "kinds if you like.",
) -> Any:
    """--object for commands that simulate a room."""
    return option(
        None,
        f"{words} See models/objects and docs/objects.md.",
        "--object",
        metavar="FILE.toml",
    )


def calibration_output_option() -> Any:
    """--calibration for commands that measure a robot."""
    return option(
        DEFAULT_CALIBRATION,
        "Where this robot's calibration is kept, one folder a robot; made if need be.",
        "--calibration",
        metavar="FOLDER",
    )


def photographs(panoramas: Sequence[Path] | None, calibration: Path | None) -> list[Path]:
    """The panoramas that were given, and those in a calibration's folder."""
    from mbot_workstation.sim.calibrated.calibration_folder import room_pictures

    return [*(panoramas or ()), *(room_pictures(calibration) if calibration else ())]


def task_option(panel: str = "") -> Any:
    """--task for commands that simulate a robot at work."""
    return option(
        "fetch",
        "What robots are to do: fetch, obstacles, hidden, bring, line, stay, or a task of your "
        "own, FILE.py, which is run.",
        "--task",
        metavar="NAME|FILE.py",
        panel=panel,
    )


def find_lesson(name: str | None, task: str) -> "Lesson":
    """The lesson of a task that --lesson names, or the last of its course.

    Raises:
        ConfigurationError: there is none, or no such task.

    """
    from mbot_workstation.tasks.find import find_task
    from mbot_workstation.tasks.lesson import lesson_named

    found = find_task(task)
    try:
        return lesson_named(found.lessons, name or found.course(guided=False, further=False)[-1])
    except ValueError as error:
        raise ConfigurationError(f"--lesson: {error}") from None


def _file(help_text: str, name: str, variable: str) -> Any:
    return option(None, help_text, name, panel=_LINK, metavar="FILE", envvar=variable)


@dataclass(frozen=True, slots=True, kw_only=True)
class CertificateOptions:
    """Who this workstation is, where addresses and not enrolled robots are named."""

    ca: Path | None = _file(_CA_HELP, "--ca", "MBOT_CA")
    certificate: Path | None = _file(_CERTIFICATE_HELP, "--certificate", "MBOT_CERTIFICATE")
    key: Path | None = _file(_KEY_HELP, "--key", "MBOT_KEY")

    def security(self) -> LinkSecurity | None:
        """The certificates to show; None without any.

        Raises:
            ConfigurationError: one is missing or can't be read.

        """
        return link_security(self.ca, self.certificate, self.key)


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkOptions:
    """Which robot, and how to reach it."""

    robot: str = option(
        "",
        "The name of an enrolled robot, or HOST, HOST:PORT, tcp/HOST:PORT, tls/HOST:PORT; this "
        "machine if not given.",
        "--robot",
        panel=_LINK,
        metavar="ROBOT",
        envvar=ADDRESS_VARIABLE,
    )
    robot_id: str | None = option(
        None,
        "Which robot, where several are alive behind one address.",
        "--id",
        panel=_LINK,
        metavar="ROBOT",
    )
    ca: Path | None = _file(_CA_HELP, "--ca", "MBOT_CA")
    certificate: Path | None = _file(_CERTIFICATE_HELP, "--certificate", "MBOT_CERTIFICATE")
    key: Path | None = _file(_KEY_HELP, "--key", "MBOT_KEY")

    def link(self) -> "RobotLink":
        """The link that is asked for, to be opened by `with`.

        Raises:
            ConfigurationError: an address, an identifier or a file is unusable.

        """
        from mbot_workstation.fleet.enrolment.enrolled_robots import find_destination
        from mbot_workstation.fleet.link.robot_link import RobotLink

        found = find_destination(
            self.robot, self.robot_id, link_security(self.ca, self.certificate, self.key)
        )
        return RobotLink(str(found.endpoint), found.robot_id, found.security)
