"""A recording's camera and a board that goes nowhere, until somebody has seen enough."""

import threading
import time
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from mbot_protocol.beat.recorded_drive import RecordedDrive
from mbot_protocol.drive.camera_model import CameraModel
from mbot_workstation.virtual.daemon_config import write_daemon_config
from mbot_workstation.virtual.live_report import LiveReport
from mbot_workstation.virtual.mcore_board import McoreBoard
from mbot_workstation.virtual.mjpeg_server import MjpegServer
from mbot_workstation.virtual.replayed_camera import ReplayedCamera, frames
from mbot_workstation.virtual.virtual_session import ready_file

POLL_S = 0.1


@dataclass(frozen=True, slots=True)
class ReplaySettings:
    """How a recording is played.

    Attributes:
        drive: which.
        camera: the camera whose frames are drawn.
        frame_rate_hz: of the stream.
        camera_port: TCP port of the stream on loopback; 0 is any free one.
        board_link: where to put a symbolic link to the board's port.
        boot_s: how long the board is deaf after its port was opened.
        ready_file, daemon_config: as in `virtual_session.Outputs`.

    """

    drive: RecordedDrive
    camera: CameraModel
    frame_rate_hz: float = 30.0
    camera_port: int = 0
    board_link: Path | None = None
    boot_s: float = 0.0
    ready_file: Path | None = None
    daemon_config: Path | None = None


def play(
    settings: ReplaySettings, report: LiveReport, stop: threading.Event, seconds: float = 0.0
) -> None:
    """Play until `stop`, or for so many seconds; 0 is no limit.

    Raises:
        MbotError: something a person can mend.

    """
    shown = frames(settings.drive, settings.camera)
    ended = threading.Event()
    with ExitStack() as parts:
        server = parts.enter_context(MjpegServer(settings.camera_port))
        board = parts.enter_context(McoreBoard(settings.board_link, boot_s=settings.boot_s))
        camera = ReplayedCamera(shown, settings.frame_rate_hz, server.publish)
        thread = threading.Thread(target=camera.run, args=(ended,), name="recording", daemon=True)
        thread.start()
        parts.callback(thread.join)
        parts.callback(ended.set)
        where = {"board": str(board.path), "camera": server.url}
        if settings.ready_file is not None:
            parts.enter_context(ready_file(settings.ready_file, where))
        if settings.daemon_config is not None:
            write_daemon_config(settings.daemon_config, **where, has_deadman=False)
        report.ready(**where, daemon_config=settings.daemon_config)
        began_s, rounds = time.monotonic(), 0
        while not stop.wait(POLL_S) and not 0 < seconds <= time.monotonic() - began_s:
            if camera.rounds != rounds:
                rounds = camera.rounds
                report.played(rounds, len(shown), board.state.commands)
