"""Drives in the Rerun viewer, live or recorded: what to log, and how the window is laid out.

Rerun is the extra `[view]`; nothing else here imports it.
"""

import importlib
import math
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Collection, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from mbot_protocol.beat.beat import Beat
from mbot_protocol.beat.changes import changes
from mbot_protocol.beat.recorded_drive import RecordedDrive
from mbot_protocol.beat.stages import span_ms
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.v1.messages_pb2 import Decision
from mbot_workstation.look.drives.attention import Look, Looks
from mbot_workstation.look.drives.driven_path import PathPoint, Point
from mbot_workstation.wording import one_line

APPLICATION = "mbot"
LATENCIES = ("frame to motors", "observe", "decide", "tick late by")
LOOPBACK = "127.0.0.1"
AHEAD_M = 0.2
MAP_M = 1.5
"""What the map shows at first, from the middle on; it can be moved and zoomed."""

ROBOT_COLOR, TARGET_COLOR, PATH_COLOR = (90, 170, 255), (220, 50, 50), (230, 170, 60)
START_WAIT_S = 20.0
MEMORY_LIMIT = "512MiB"
"""What the server keeps for a viewer that connects later: hours of a robot."""


class RerunView:
    """A Rerun recording that drives of one or several robots are logged into. A context manager.

    Each robot has its own branch, named by its id; times are the robot's wall clock.
    """

    def __init__(
        self, robots: list[str], mapped: Collection[str] = (), *, attention: bool = False
    ) -> None:
        """Begin.

        Args:
            robots: who is shown.
            mapped: those of them whose place is known: with a map.
            attention: with a place for what mattered to their policies.

        Raises:
            ConfigurationError: Rerun is not installed.

        """
        try:
            self._rerun: Any = importlib.import_module("rerun")
            layout: Any = importlib.import_module("rerun.blueprint")
        except ModuleNotFoundError as error:
            raise ConfigurationError(
                f"view needs {error.name}: pip install -c constraints.txt -e '.[view]' in the "
                "checkout (it takes 700 MB)"
            ) from None
        self._blueprint = layout.Blueprint(
            layout.Horizontal(
                *(_robot_view(layout, robot, robot in mapped, attention) for robot in robots)
            ),
            layout.BlueprintPanel(state="collapsed"),
            layout.SelectionPanel(state="collapsed"),
            layout.TimePanel(state="collapsed"),
        )
        self._stream: Any = self._rerun.RecordingStream(APPLICATION)
        self._before: dict[str, Decision] = {}
        self._end = ExitStack()

    def __enter__(self) -> "RerunView":
        return self

    def __exit__(self, *_: object) -> None:
        self._stream.flush()
        self._stream.disconnect()
        self._end.close()

    def save(self, path: Path) -> None:
        """Write into a file that the viewer opens; raises ConfigurationError."""
        if not path.absolute().parent.is_dir():
            raise ConfigurationError(f"no folder {path.absolute().parent} to write {path.name} to")
        self._stream.save(str(path), default_blueprint=self._blueprint)

    def open_window(self, *, grpc_port: int) -> None:
        """Open the viewer's window; it stays when this process ends. Raises ConfigurationError."""
        self._start([], grpc_port, [])

    def serve_web(self, *, grpc_port: int, web_port: int) -> str:
        """Serve the viewer as a page; returns the page's address on this machine.

        Raises:
            ConfigurationError: the viewer does not start; is a port taken?

        """
        for port, name in ((grpc_port, "--grpc-port"), (web_port, "--web-port")):
            if _listens(port):
                raise ConfigurationError(
                    f"port {port} is taken, by another `view` perhaps: end that, or give another "
                    f"{name}"
                )
        # The server is not the library's own: that one listens on every network (0.0.0.0).
        options = ["--serve-web", "--web-viewer-port", str(web_port), "--server-memory-limit"]
        # Linux ends it with us even where we are killed: rerun_cli, interrupted, kills the server.
        setpriv = ["setpriv", "--pdeathsig", "INT"] if shutil.which("setpriv") else []
        server = self._start(setpriv, grpc_port, [*options, MEMORY_LIMIT])
        self._end.callback(lambda: os.killpg(server.pid, signal.SIGTERM))
        return f"http://127.0.0.1:{web_port}/?url={_source(grpc_port)}"

    def _start(
        self, within: list[str], grpc_port: int, options: list[str]
    ) -> "subprocess.Popen[bytes]":
        """Rerun's own program, for this machine only; what is logged goes there."""
        bound = ["--bind", LOOPBACK, "--port", str(grpc_port)]
        command = [*within, sys.executable, "-m", "rerun_cli", *bound, *options]
        process = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
        )
        until_s = time.monotonic() + START_WAIT_S
        while not _listens(grpc_port):
            if process.poll() is not None or time.monotonic() > until_s:
                raise ConfigurationError(
                    f"Rerun's viewer does not start on port {grpc_port}; is there a display, or "
                    "--web; is the port taken (--grpc-port)?"
                )
            time.sleep(0.1)
        self._stream.connect_grpc(_source(grpc_port), default_blueprint=self._blueprint)
        return process

    def log_drive(self, drive: RecordedDrive, looks: Looks | None = None) -> None:
        """A whole recording, and where its policy looked, as far as that is given."""
        for beat in drive.beats:
            look = (looks or {}).get(beat.key)
            if look is not None:
                self._log_look(drive.robot_id, beat.decision, look)
            if beat.encoded:
                self.log_picture(
                    drive.robot_id, beat.encoded, beat.decision.unix_time_ns, exact=beat.is_exact
                )
            self.log_decision(beat.decision)

    def _log_look(self, robot: str, decision: Decision, look: Look) -> None:
        self._at(decision.unix_time_ns)
        self._stream.log(f"{robot}/attention", self._rerun.Image(look.picture))
        if look.without_memory is not None:
            for side, value in zip(("left", "right"), look.without_memory, strict=True):
                path = f"{robot}/action/{side}_without_memory"
                self._stream.log(path, self._rerun.Scalars(value))

    def log_picture(
        self, robot: str, encoded: bytes, time_ns: int, *, exact: bool, of_camera: bool = False
    ) -> None:
        """What the policy or the camera saw, PNG where it is exact, else JPEG."""
        self._at(time_ns)
        kind = "image/png" if exact else "image/jpeg"
        picture = self._rerun.EncodedImage(contents=encoded, media_type=kind)
        self._stream.log(f"{robot}/{'camera' if of_camera else 'observation'}", picture)

    def log_decision(self, decision: Decision) -> None:
        """One beat: wheels, latencies, counters, and what has changed, in words."""
        robot, log, rerun = decision.robot_id, self._stream.log, self._rerun
        self._at(decision.unix_time_ns)
        self._stream.set_time("beat", sequence=decision.sequence)
        for side, told in zip(("left", "right"), Beat(decision).at_wheels(), strict=True):
            log(f"{robot}/wheels/{side}", rerun.Scalars(told))
            if decision.HasField("action"):
                log(f"{robot}/action/{side}", rerun.Scalars(getattr(decision.action, side)))
        spans = span_ms(decision)
        for name in LATENCIES:
            if name in spans:
                log(f"{robot}/latency_ms/{name.replace(' ', '_')}", rerun.Scalars(spans[name]))
        log(f"{robot}/count/stops", rerun.Scalars(decision.stop_count))
        log(f"{robot}/count/missed_beats", rerun.Scalars(decision.missed_ticks))
        for level, words in changes(self._before.get(robot), decision):
            log(f"{robot}/log", rerun.TextLog(one_line(words), level=level))
        self._before[robot] = decision

    def log_place(self, robot: str, place: PathPoint) -> None:
        """Where a robot and its object are; the map's up is y, which Rerun draws downward."""
        self._at(place.unix_time_ns)
        (x_m, y_m), (target_x_m, target_y_m) = place.robot, place.target
        ahead = math.cos(place.yaw_rad) * AHEAD_M, -math.sin(place.yaw_rad) * AHEAD_M
        arrow = self._rerun.Arrows2D(
            origins=[(x_m, -y_m)], vectors=[ahead], colors=[ROBOT_COLOR], radii=0.03
        )
        self._stream.log(f"{robot}/map/robot", arrow)
        box = self._rerun.Boxes2D(
            centers=[(target_x_m, -target_y_m)], sizes=[(0.06, 0.06)], colors=[TARGET_COLOR]
        )
        self._stream.log(f"{robot}/map/object", box)

    def log_path(self, robot: str, time_ns: int, strips: Sequence[Sequence[Point]]) -> None:
        """The lines it has driven so far."""
        self._at(time_ns)
        lines = [[(x_m, -y_m) for x_m, y_m in strip] for strip in strips]
        drawn = self._rerun.LineStrips2D(lines, colors=[PATH_COLOR] * len(lines), radii=0.012)
        self._stream.log(f"{robot}/map/path", drawn)

    def _at(self, time_ns: int) -> None:
        self._stream.set_time("robot_time", timestamp=time_ns / 1e9)


def _source(grpc_port: int) -> str:
    return f"rerun+http://{LOOPBACK}:{grpc_port}/proxy"


def _listens(port: int) -> bool:
    with socket.socket() as probe:
        probe.settimeout(0.5)
        return probe.connect_ex((LOOPBACK, port)) == 0


def _robot_view(layout: Any, robot: str, has_map: bool, has_attention: bool) -> Any:
    """One robot's part of the window: picture, map and log on the left, lines on the right."""
    bounds = layout.VisualBounds2D(x_range=(-MAP_M, MAP_M), y_range=(-MAP_M, MAP_M))
    map_view = layout.Spatial2DView(
        origin=f"{robot}/map", name="path, metres", visual_bounds=bounds
    )
    attention = layout.Spatial2DView(origin=f"{robot}/attention", name="what mattered to it")
    return layout.Horizontal(
        layout.Vertical(
            layout.Horizontal(
                layout.Spatial2DView(origin=f"{robot}/camera", name=f"{robot}: camera, live only"),
                layout.Spatial2DView(origin=f"{robot}/observation", name="as the policy sees"),
                *([attention] if has_attention else []),
            ),
            *([map_view] if has_map else []),
            layout.TextLogView(origin=f"{robot}/log", name="state, faults, stops"),
            row_shares=[3, 4, 2] if has_map else [3, 2],
        ),
        layout.Vertical(
            layout.TimeSeriesView(origin=f"{robot}/wheels", name="wheels"),
            layout.TimeSeriesView(origin=f"{robot}/action", name="action"),
            layout.TimeSeriesView(origin=f"{robot}/latency_ms", name="latency, ms"),
            layout.TimeSeriesView(origin=f"{robot}/count", name="stops, missed beats"),
        ),
        column_shares=[1, 1],
        name=robot,
    )
