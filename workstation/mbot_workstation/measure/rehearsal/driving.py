"""The virtual robot and its daemon, driven through the maneuvers as a person would."""

import json
import socket
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import msgspec

from mbot_protocol.errors import ConfigurationError, MbotError, UnreachableError
from mbot_workstation.fleet.link.robot_link import RobotLink
from mbot_workstation.measure.rehearsal.command_line import CommandLine
from mbot_workstation.measure.tracks.commands_csv import read_commands
from mbot_workstation.measure.tracks.recording_folder import COMMANDS_FILE, read_maneuvers
from mbot_workstation.measure.tracks.recording_toml import read_info, write_info
from mbot_workstation.measure.tracks.run import UnusableRunError
from mbot_workstation.virtual.child import Child

ROBOT_ID = "virtual-mbot"
READY_TIMEOUT_S = 90.0

TRACKER_AHEAD_MM, TRACKER_LEFT_MM = -32.0, 11.0
"""Where the tracker sits on the robot: nowhere in particular, and nobody tells `identify`."""

CONFIGURATION = """\
robot_id = "{robot_id}"
[camera]
source = "{camera}"
[board]
port = "{board}"
accept_no_deadman = true
[models]
directory = "{models}"
[network]
listen = ["tcp/{address}"]
"""


@contextmanager
def robot_pair(line: CommandLine, truth: Path, track: str) -> Iterator[str]:
    """Start both, uncalibrated daemon and true robot, and end them afterwards.

    Args:
        line: shows the commands.
        truth: the calibration folder the robot is made from.
        track: file in the line's folder for what a tracker on it would write.

    Yields:
        The daemon's address for `--robot`.

    Raises:
        MbotError: one of them did not start.

    """
    folder = line.folder
    address = f"127.0.0.1:{_free_port()}"
    with ExitStack() as stack:
        state = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        ready = folder / "ready.json"
        options = [
            *("--free-floor", "--plain", "--frame-rate", "10", "--camera-port", "0"),
            *("--truth-offset", f"{TRACKER_AHEAD_MM:g}", f"{TRACKER_LEFT_MM:g}"),
        ]
        line.show(
            [
                *("workstation", "virtual-robot", "--calibration", "TRUTH"),
                *("--truth-track", track, *options),
            ],
            " &",
        )
        robot = stack.enter_context(
            Child(
                "workstation",
                [
                    *("virtual-robot", "--calibration", str(truth), *options),
                    *("--truth-track", str(folder / track), "--board", str(state / "board")),
                    *("--ready-file", str(ready)),
                ],
                folder / "log" / "virtual-robot.log",
            )
        )
        robot.wait_until(ready.exists, READY_TIMEOUT_S, "the virtual robot did not start")
        configuration = _write_configuration(folder, state / "models", address, ready)
        line.show(["mbot-agent", "run", "--config", configuration.name], " &")
        agent = stack.enter_context(
            Child(
                "mbot-agent",
                ["run", "--config", str(configuration)],
                folder / "log" / "mbot-agent.log",
            )
        )
        agent.wait_until(lambda: _drives(address), READY_TIMEOUT_S, "the daemon is not ready")
        yield address


def _write_configuration(folder: Path, models: Path, address: str, ready: Path) -> Path:
    """robot.toml for the daemon of the virtual robot that has written its ready file."""
    path = folder / "robot.toml"
    places = json.loads(ready.read_text())
    path.write_text(
        CONFIGURATION.format(robot_id=ROBOT_ID, models=models, address=address, **places)
    )
    return path


def _drives(address: str) -> bool:
    """Whether the daemon answers and has its board."""
    try:
        with RobotLink(address) as link:
            faults = [fault.kind for fault in link.status().faults]
    except UnreachableError:
        return False
    return not any(kind.startswith(("board", "camera")) for kind in faults)


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


ATTEMPTS_WITHOUT_PROGRESS = 3
"""On a machine that is too slow for real time no attempt ever gets further."""


def drive_session(line: CommandLine, recording: str, *options: str) -> None:
    """Record all maneuvers.

    Args:
        line: to type at.
        recording: the new recording's folder, in the line's folder.
        options: of `workstation maneuvers run`, but for where to record.

    Raises:
        MbotError: several attempts in a row recorded nothing more.

    """
    command = ["workstation", "maneuvers", "run", *options]
    folder = line.folder / recording
    done, failures = 0, 0
    where = ["--output", recording]
    while True:
        try:
            line.run(*command, *where, quiet=True)
        except MbotError as error:
            now = _recorded(folder)
            failures = 0 if now > done else failures + 1
            done = now
            if failures >= ATTEMPTS_WITHOUT_PROGRESS:
                raise
            line.say(f"a run was spoilt ({error.facts.get('said', error)}); go on")
            if done or (folder / COMMANDS_FILE).exists():
                where = ["--resume", recording]
        else:
            return


def _recorded(folder: Path) -> int:
    """How many runs are there."""
    path = folder / COMMANDS_FILE
    return len(read_commands(path, may_be_empty=True)) if path.exists() else 0


MOST_SHARE = 0.25
"""A machine that loses more tracks is too slow for real time."""


def leave_out_spoilt(folder: Path) -> tuple[int, ...]:
    """Add to recording.toml the runs that can't be used, one after the other.

    Args:
        folder: of a recording with its track.

    Returns:
        Their numbers.

    Raises:
        ConfigurationError: something else is wrong with the recording, or too many are spoilt.

    """
    spoilt: list[int] = []
    while True:
        try:
            usable = len(read_maneuvers(folder).runs)
        except UnusableRunError as error:
            spoilt.append(error.number)
            info = read_info(folder)
            write_info(folder, msgspec.structs.replace(info, leave_out=tuple(spoilt)))
        else:
            break
    if len(spoilt) > MOST_SHARE * (usable + len(spoilt)):
        raise ConfigurationError(
            f"{len(spoilt)} of {usable + len(spoilt)} tracks have holes: this machine is too busy "
            "to play a robot in real time; try again when it has less to do"
        )
    return tuple(spoilt)
