"""A virtual robot and a daemon that drives it, each as its own program, found as over a network."""

import json
import socket
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from mbot_protocol.drive.calibration import read_camera
from mbot_protocol.errors import RefusedError, UnreachableError
from mbot_workstation.fleet.link.robot_link import RobotLink
from mbot_workstation.fleet.models.signing_key import SigningKey
from mbot_workstation.sim.calibrated.motion_calibration import read_motion
from mbot_workstation.virtual.child import Child

READY_TIMEOUT_S = 60.0

ROBOT_LOG, AGENT_LOG = "virtual-robot.log", "agent.log"
LEAVES = (AGENT_LOG, "ready.json", "robot.toml")
"""What is left in the folder beside the virtual robot's log."""

CONFIGURATION = """\
robot_id = "{robot_id}"
calibration = "{calibration}"
[camera]
source = "{camera}"
[board]
port = "{board}"
accept_no_deadman = {accept_no_deadman}
[models]
directory = "{models}"
[trust]
keys = ["{key}"]
[network]
listen = ["tcp/{address}"]
"""


@dataclass(frozen=True, slots=True)
class DaemonSettings:
    """What the daemon is told besides where camera and board are.

    Attributes:
        robot_id: what the robot is called.
        calibration: of the robot.
        accept_no_deadman: drive even if the board would drive on without the daemon.

    """

    robot_id: str
    calibration: Path | None = None
    accept_no_deadman: bool = True


@dataclass(frozen=True, slots=True)
class DrivenRobot:
    """Both programs, up.

    Attributes:
        robot, agent: the virtual robot and its daemon.
        address: where the daemon listens.
        key: what it trusts: models signed by it are taken.

    """

    robot: Child
    agent: Child
    address: str
    key: SigningKey

    def wait_until_drivable(self) -> None:
        """Wait until at most a model is missing; raises as `blocking_faults` and `Child`."""
        with RobotLink(self.address) as link:
            words = "the daemon is not ready to drive"
            self.agent.wait_until(lambda: not blocking_faults(link), READY_TIMEOUT_S, words)


@contextmanager
def driven_robot(
    folder: Path, settings: DaemonSettings, options: Sequence[str] = ()
) -> Iterator[DrivenRobot]:
    """Start both, on free ports of this machine, and end both in the end.

    Args:
        folder: for their logs and the daemon's configuration.
        settings: of the daemon.
        options: further ones of `workstation virtual-robot`.

    Raises:
        MbotError: one did not start; with its last words.

    """
    address = f"127.0.0.1:{_free_port()}"
    ready, configuration = folder / "ready.json", folder / "robot.toml"
    key = SigningKey.ephemeral("virtual")
    with TemporaryDirectory() as made:
        state = Path(made)
        arguments = [
            *("virtual-robot", "--camera-port", "0", "--board", str(state / "board")),
            *("--ready-file", str(ready), *options),
        ]
        with Child("workstation", arguments, folder / ROBOT_LOG) as robot:
            robot.wait_until(ready.exists, READY_TIMEOUT_S, "the virtual robot did not start")
            places = json.loads(ready.read_text())
            text = daemon_configuration(
                settings, places, state / "models", key.public.line, address
            )
            configuration.write_text(text)
            command = ["run", "--config", str(configuration)]
            with Child("mbot-agent", command, folder / AGENT_LOG) as agent:
                agent.wait_until(
                    lambda: _listens(address), READY_TIMEOUT_S, "the daemon does not listen"
                )
                yield DrivenRobot(robot, agent, address, key)


def daemon_configuration(
    settings: DaemonSettings, places: Mapping[str, str], models: Path, key: str, address: str
) -> str:
    """The daemon's robot.toml.

    Args:
        settings: of the daemon.
        places: of the virtual robot's `board` and `camera`, as its ready file names them.
        models: folder for what is pushed.
        key: the line of the one that is trusted.
        address: where to listen, as HOST:PORT.

    """
    return CONFIGURATION.format(
        robot_id=settings.robot_id,
        accept_no_deadman=str(settings.accept_no_deadman).lower(),
        calibration=_daemons_part(settings.calibration),
        models=models,
        key=key,
        address=address,
        **places,
    )


def blocking_faults(link: RobotLink) -> list[str]:
    """What keeps it from driving once it has a model, by kind.

    Raises:
        RefusedError: the board has no dead man's switch: waiting would not mend that.

    """
    status = link.status()
    faults = [fault.kind for fault in status.faults if fault.kind != "no-model"]
    if "board-no-deadman" in faults:
        raise RefusedError(
            f"the board's firmware ({status.board_version}) keeps its last command for ever if the "
            "daemon dies, so the daemon does not drive it; --accept-no-deadman lets it"
        )
    return faults


def _daemons_part(calibration: Path | None) -> str:
    """The folder as the daemon's configuration names it; empty if it holds nothing for it."""
    if calibration is None:
        return ""
    folder = calibration.absolute()
    return str(folder) if read_camera(folder) or read_motion(folder) else ""


def _listens(address: str) -> bool:
    try:
        with RobotLink(address) as link:
            link.status()
    except UnreachableError:
        return False
    return True


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]
