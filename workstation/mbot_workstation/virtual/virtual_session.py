"""One run of the virtual robot: start it, report, write the files, until it is told to stop."""

import json
import queue
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mbot_protocol.errors import MbotError
from mbot_protocol.files import atomic_file
from mbot_workstation.virtual.daemon_config import write_daemon_config
from mbot_workstation.virtual.live_report import LiveReport
from mbot_workstation.virtual.stand_in import VirtualRobot, VirtualRobotSettings
from mbot_workstation.virtual.trajectory import TrajectoryWriter
from mbot_workstation.virtual.truth_track import TrackerSettings, TruthTrack
from mbot_workstation.virtual.video_recorder import record
from mbot_workstation.virtual.viewer_window import check_display, show

POLL_S = 0.1
"""How often the trajectory gets a point: 4 cm at full speed."""

STATUS_EVERY = 10
"""A status line every so many polls."""


@dataclass(frozen=True, slots=True)
class Outputs:
    """Where a run leaves its traces; None is nowhere.

    Attributes:
        result: JSON file with the run in figures.
        trajectory: JSON lines, see TrajectoryWriter.
        film: MP4 file.
        truth_track: what a tracker on the robot would see, see TruthTrack.
        tracker: of `truth_track`.
        ready_file: JSON file with `board` and `camera`, there while the robot is up.
        daemon_config: a configuration for a daemon that is to drive it, see write_daemon_config.
        view: whether to open a window.

    """

    result: Path | None = None
    trajectory: Path | None = None
    film: Path | None = None
    truth_track: Path | None = None
    tracker: TrackerSettings = field(default_factory=TrackerSettings)
    ready_file: Path | None = None
    daemon_config: Path | None = None
    view: bool = False


def run_session(
    settings: VirtualRobotSettings,
    outputs: Outputs,
    report: LiveReport,
    stop: threading.Event,
    seconds: float = 0.0,
) -> Mapping[str, Any]:
    """Run the virtual robot until `stop`, the end of the task, or so many seconds; 0 is no limit.

    Returns:
        The run in figures, in JSON's types.

    Raises:
        MbotError: something a person can mend.

    """
    if outputs.view:
        check_display()
    with ExitStack() as resources:
        trajectory = (
            resources.enter_context(TrajectoryWriter(outputs.trajectory))
            if outputs.trajectory
            else None
        )
        truth = (
            resources.enter_context(TruthTrack(outputs.truth_track, outputs.tracker))
            if outputs.truth_track
            else None
        )
        robot = resources.enter_context(VirtualRobot(settings))
        if not robot.wait_until_ready():
            raise MbotError("the camera gave no picture within 30 s; is this machine overloaded?")
        if truth is not None:
            robot.run_beside("tracker", lambda stopped: truth.run(robot.world.history, stopped))
        if (film := outputs.film) is not None:
            robot.run_beside("film", lambda stopped: record(robot, film, stopped))
        if outputs.view:
            robot.run_beside("window", lambda stopped: show(robot, stopped))
        ready = {"board": str(robot.board.path), "camera": robot.server.url}
        if outputs.ready_file is not None:
            resources.enter_context(ready_file(outputs.ready_file, ready))
        if outputs.daemon_config is not None:
            deadman = settings.firmware is not None
            write_daemon_config(outputs.daemon_config, **ready, has_deadman=deadman)
        report.ready(**ready, daemon_config=outputs.daemon_config)
        _follow(robot, report, trajectory, stop, seconds)
        result = robot.world.status().result
    robot.raise_failure()
    report.result(result, robot.world.task)
    if outputs.result is not None:
        _write_json(outputs.result, result)
    return result


def _follow(
    robot: VirtualRobot,
    report: LiveReport,
    trajectory: TrajectoryWriter | None,
    stop: threading.Event,
    seconds: float,
) -> None:
    """Report and record until something ends the run."""
    began_s = time.monotonic()
    polls, stopped_s = 0, 0.0
    while True:
        over = robot.stopped.is_set()
        status = robot.world.status()
        while True:
            try:
                event = robot.world.events.get_nowait()
            except queue.Empty:
                break
            report.event(event, robot.world.task)
            if trajectory is not None:
                trajectory.add_event(event)
        board = robot.board.state
        if board.silent_ms and board.since_s != stopped_s:
            stopped_s = board.since_s
            report.board_stopped(board.silent_ms)
        if trajectory is not None:
            trajectory.add(status)
        if polls % STATUS_EVERY == 0:
            report.status(status, robot.world.task, robot.camera.frames, board.commands)
        if over or stop.wait(POLL_S) or 0 < seconds <= time.monotonic() - began_s:
            return
        polls += 1


@contextmanager
def ready_file(path: Path, where: dict[str, str]) -> Iterator[None]:
    """A file that exists while a robot is up, and says where its board and camera are."""
    _write_json(path, where)
    try:
        yield
    finally:
        path.unlink(missing_ok=True)


def _write_json(path: Path, fields: Mapping[str, object]) -> None:
    # Whoever waits for the file never reads half of it.
    atomic_file.save(path, (json.dumps(fields, indent=2) + "\n").encode())
