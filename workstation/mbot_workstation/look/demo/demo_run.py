"""The demonstration: every part as its own program, talking as they would over a network."""

import json
import socket
import tempfile
import time
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from mbot_protocol.beat.recorded_drive import read_drive
from mbot_protocol.drive.calibration import read_camera
from mbot_protocol.errors import MbotError, RefusedError, UnreachableError
from mbot_protocol.v1.messages_pb2 import Decision
from mbot_workstation.fleet.link.remote_control import RemoteControl
from mbot_workstation.fleet.link.robot_link import RobotLink
from mbot_workstation.fleet.models.push import push
from mbot_workstation.fleet.models.signing_key import SigningKey
from mbot_workstation.fleet.telemetry.output import Output
from mbot_workstation.fleet.telemetry.stream import Sample, TelemetryStream
from mbot_workstation.fleet.telemetry.telemetry_file import TelemetryFile
from mbot_workstation.fresh_folder import make_fresh
from mbot_workstation.look.demo.contact_sheet import contact_sheet, path_side_px
from mbot_workstation.look.demo.demo_result import DemoResult, summarise
from mbot_workstation.look.demo.path_drawing import draw_path, read_trajectory
from mbot_workstation.pictures.picture_file import write_picture
from mbot_workstation.sim.calibrated.motion_calibration import read_motion
from mbot_workstation.virtual.child import Child

ROBOT_ID = "virtual-mbot"
ENOUGH_TOUCHES = 10
READY_TIMEOUT_S = 60.0

ROBOT_LOG = "virtual-robot.log"
LEAVES = (
    *("agent.log", "contact-sheet.png", "ready.json", "recording.mcap", "result.json"),
    *("robot.toml", "trajectory.jsonl"),
)
"""What a demo leaves beside the virtual robot's log."""

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
class DemoSettings:
    """What to show.

    Attributes:
        model: the policy to push.
        output: folder for recording, pictures, logs.
        seconds: of driving, at most.
        virtual_robot: further options of `workstation virtual-robot`.
        calibration: of the robot, for its daemon.
        accept_no_deadman: drive even if the board would drive on without the daemon.

    """

    model: Path
    output: Path
    seconds: float
    virtual_robot: tuple[str, ...] = ()
    calibration: Path | None = None
    accept_no_deadman: bool = True


def run_demo(settings: DemoSettings, output: Output) -> DemoResult:
    """Run everything, watch it on `output`, leave the pictures.

    Raises:
        MbotError: a part did not start or broke.

    """
    folder = settings.output
    make_fresh(folder, ROBOT_LOG, LEAVES)
    address = f"127.0.0.1:{_free_port()}"
    ready = folder / "ready.json"
    with ExitStack() as stack:
        state = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        arguments = [
            *("virtual-robot", "--camera-port", "0", "--board", str(state / "board")),
            *("--result", str(folder / "result.json"), "--ready-file", str(ready)),
            *("--trajectory", str(folder / "trajectory.jsonl"), *settings.virtual_robot),
        ]
        robot = stack.enter_context(Child("workstation", arguments, folder / ROBOT_LOG))
        robot.wait_until(ready.exists, READY_TIMEOUT_S, "the virtual robot did not start")
        places = json.loads(ready.read_text())
        configuration = folder / "robot.toml"
        key = SigningKey.ephemeral("demo")
        configuration.write_text(
            daemon_configuration(settings, places, state / "models", key.public.line, address)
        )
        agent = stack.enter_context(
            Child("mbot-agent", ["run", "--config", str(configuration)], folder / "agent.log")
        )
        link = stack.enter_context(_connect(agent, address))
        agent.wait_until(
            lambda: not blocking_faults(link), READY_TIMEOUT_S, "the daemon is not ready to drive"
        )
        started_s = time.monotonic()
        push(link, settings.model, lambda _: key)
        push_s = time.monotonic() - started_s
        board = link.status()
        recording = stack.enter_context(TelemetryFile(folder / "recording.mcap", link.robot_id))
        stream = stack.enter_context(TelemetryStream(link))
        stack.enter_context(output)
        cpu_before_s, began_s = agent.cpu_s, time.monotonic()
        decisions = drive(link, stream, recording, output, settings, folder)
        driven_s = time.monotonic() - began_s
        cpu_share = (agent.cpu_s - cpu_before_s) / driven_s
        if agent.end() != 0:
            raise MbotError(f"the daemon did not end well, see {folder / 'agent.log'}")
        robot.end()
    result = summarise(folder, decisions, driven_s, cpu_share, push_s, board)
    _draw(folder, result)
    return result


def daemon_configuration(
    settings: DemoSettings, places: Mapping[str, str], models: Path, key: str, address: str
) -> str:
    """The daemon's robot.toml.

    Args:
        settings: of the demonstration.
        places: of the virtual robot's `board` and `camera`, as its ready file names them.
        models: folder for what is pushed.
        key: the line of the one that is trusted.
        address: where to listen, as HOST:PORT.

    """
    return CONFIGURATION.format(
        robot_id=ROBOT_ID,
        accept_no_deadman=str(settings.accept_no_deadman).lower(),
        calibration=_daemons_part(settings.calibration),
        models=models,
        key=key,
        address=address,
        **places,
    )


def _daemons_part(calibration: Path | None) -> str:
    """The folder as the daemon's configuration names it; empty if it holds nothing for it."""
    if calibration is None:
        return ""
    folder = calibration.absolute()
    return str(folder) if read_camera(folder) or read_motion(folder) else ""


def drive(
    link: RobotLink,
    stream: TelemetryStream,
    recording: TelemetryFile,
    output: Output,
    settings: DemoSettings,
    folder: Path,
) -> list[Decision]:
    """Let the policy drive until time or objects are up, and stop it whatever happens.

    Returns:
        The decisions it took. All telemetry has gone to `recording` and `output` as well.

    """
    control = RemoteControl(link)
    decisions: list[Decision] = []

    def take(samples: list[Sample]) -> None:
        for sample in samples:
            output.take(sample)
            recording.write(sample.message)
            if isinstance(sample.message, Decision) and sample.message.HasField("action"):
                decisions.append(sample.message)
        output.refresh(stream.state, stream.silence_s)
        recording.save_if_due()

    control.run(when_ready=True)
    until_s = time.monotonic() + settings.seconds
    try:
        while time.monotonic() < until_s and _touches(folder) < ENOUGH_TOUCHES:
            take(stream.poll(0.1))
    finally:
        control.stop()
    take(stream.poll(0.5))
    return decisions


def _touches(folder: Path) -> int:
    try:
        return (folder / "trajectory.jsonl").read_text().count('"event": "touch"')
    except OSError:
        return 0


def _connect(agent: Child, address: str) -> RobotLink:
    """A link to the daemon as soon as it listens."""
    found: list[RobotLink] = []

    def listens() -> bool:
        try:
            with RobotLink(address) as link:
                link.status()
        except UnreachableError:
            return False
        found.append(RobotLink(address))
        return True

    agent.wait_until(listens, READY_TIMEOUT_S, "the daemon does not listen")
    return found[0]


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


def _draw(folder: Path, result: DemoResult) -> None:
    path = draw_path(read_trajectory(folder / "trajectory.jsonl"), path_side_px())
    title = (
        f"{result.touches} objects in {result.driven_s:.0f} s, {result.distance_driven_m:.1f} m; "
        f"{result.decisions} decisions, frame to motors p50 {result.frame_p50_ms:.1f} ms"
    )
    seen = [beat for beat in read_drive(folder / "recording.mcap").decided if beat.encoded]
    write_picture(folder / "contact-sheet.png", contact_sheet(seen, path, title))


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]
