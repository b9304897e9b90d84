"""The demonstration: every part as its own program, talking as they would over a network."""

import time
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from mbot_protocol.beat.recorded_drive import read_drive
from mbot_protocol.errors import MbotError
from mbot_protocol.v1.messages_pb2 import Decision
from mbot_workstation.fleet.link.remote_control import RemoteControl
from mbot_workstation.fleet.link.robot_link import RobotLink
from mbot_workstation.fleet.models.push import push
from mbot_workstation.fleet.telemetry.output import Output
from mbot_workstation.fleet.telemetry.stream import Sample, TelemetryStream
from mbot_workstation.fleet.telemetry.telemetry_file import TelemetryFile
from mbot_workstation.fresh_folder import make_fresh
from mbot_workstation.look.demo.contact_sheet import contact_sheet, path_side_px
from mbot_workstation.look.demo.demo_result import DemoResult, summarise
from mbot_workstation.look.demo.path_drawing import draw_path, read_trajectory
from mbot_workstation.pictures.picture_file import write_picture
from mbot_workstation.virtual import with_daemon
from mbot_workstation.virtual.with_daemon import (
    AGENT_LOG,
    ROBOT_LOG,
    DaemonSettings,
    driven_robot,
)

ROBOT_ID = "virtual-mbot"
ENOUGH_TOUCHES = 10

LEAVES = (
    *with_daemon.LEAVES,
    *("contact-sheet.png", "recording.mcap", "result.json", "trajectory.jsonl"),
)
"""What a demo leaves beside the virtual robot's log."""


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
    options = [
        *("--result", str(folder / "result.json")),
        *("--trajectory", str(folder / "trajectory.jsonl"), *settings.virtual_robot),
    ]
    daemon = DaemonSettings(ROBOT_ID, settings.calibration, settings.accept_no_deadman)
    with ExitStack() as stack:
        both = stack.enter_context(driven_robot(folder, daemon, options))
        both.wait_until_drivable()
        link = stack.enter_context(RobotLink(both.address))
        started_s = time.monotonic()
        push(link, settings.model, lambda _: both.key)
        push_s = time.monotonic() - started_s
        board = link.status()
        recording = stack.enter_context(TelemetryFile(folder / "recording.mcap", link.robot_id))
        stream = stack.enter_context(TelemetryStream(link))
        stack.enter_context(output)
        cpu_before_s, began_s = both.agent.cpu_s, time.monotonic()
        decisions = drive(link, stream, recording, output, settings, folder)
        driven_s = time.monotonic() - began_s
        cpu_share = (both.agent.cpu_s - cpu_before_s) / driven_s
        if both.agent.end() != 0:
            raise MbotError(f"the daemon did not end well, see {folder / AGENT_LOG}")
        both.robot.end()
    result = summarise(folder, decisions, driven_s, cpu_share, push_s, board)
    _draw(folder, result)
    return result


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


def _draw(folder: Path, result: DemoResult) -> None:
    path = draw_path(read_trajectory(folder / "trajectory.jsonl"), path_side_px())
    title = (
        f"{result.touches} objects in {result.driven_s:.0f} s, {result.distance_driven_m:.1f} m; "
        f"{result.decisions} decisions, frame to motors p50 {result.frame_p50_ms:.1f} ms"
    )
    seen = [beat for beat in read_drive(folder / "recording.mcap").decided if beat.encoded]
    write_picture(folder / "contact-sheet.png", contact_sheet(seen, path, title))
