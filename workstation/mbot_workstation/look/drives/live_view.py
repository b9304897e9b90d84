"""Live robots, one or several, into the Rerun viewer."""

import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Protocol

from mbot_protocol.v1.messages_pb2 import Decision
from mbot_workstation.fleet.link.robot_link import RobotLink
from mbot_workstation.fleet.telemetry.stream import Sample, TelemetryStream
from mbot_workstation.look.drives.driven_path import DrivenPath, PathFile, PathPoint, Point
from mbot_workstation.look.drives.rerun_view import RerunView

_POLL_S = 0.05
_DRAW_PATH_EVERY_S = 0.5


def follow(
    viewer: RerunView,
    links: Sequence[RobotLink],
    paths: Mapping[str, Path],
    seconds: float | None = None,
) -> None:
    """Log what robots publish, until interrupted or for so many seconds.

    Args:
        viewer: where to.
        links: open ones, one a robot.
        paths: by robot: where its virtual world writes its trajectory.
        seconds: None: no end.

    Raises:
        MbotError: a robot speaks a newer schema, or a path is none.

    """
    until_s = None if seconds is None else time.monotonic() + seconds
    with ExitStack() as stack:
        streams = {
            link.robot_id: stack.enter_context(
                TelemetryStream(link, link.status().decision_rate_hz, camera=True)
            )
            for link in links
        }
        maps = [MapLog(viewer, robot, path) for robot, path in paths.items()]
        for one in maps:
            stack.callback(one.close)
        while until_s is None or time.monotonic() < until_s:
            for robot, stream in streams.items():
                for sample in stream.poll(_POLL_S / len(streams)):
                    log_sample(viewer, robot, sample)
            for one in maps:
                one.log_new()


def log_sample(viewer: RerunView, robot: str, sample: Sample) -> None:
    """One message of telemetry."""
    message = sample.message
    if isinstance(message, Decision):
        viewer.log_decision(message)
    else:
        viewer.log_picture(
            robot,
            message.data,
            message.timestamp.ToNanoseconds(),
            exact=False,
            of_camera=sample.of_camera,
        )


class Map(Protocol):
    """What of a `RerunView` a map is drawn by."""

    def log_place(self, robot: str, place: PathPoint) -> None:
        """Where a robot and its object are."""
        ...

    def log_path(self, robot: str, time_ns: int, strips: Sequence[Sequence[Point]]) -> None:
        """The lines it has driven so far."""
        ...


class MapLog:
    """One robot's map, from the file in which its virtual world writes where everything is."""

    def __init__(self, viewer: Map, robot: str, path: Path) -> None:
        """Open the file; raises ConfigurationError."""
        self._viewer = viewer
        self._robot = robot
        self._file = PathFile(path)
        self._path = DrivenPath()
        self._drawn_s = -_DRAW_PATH_EVERY_S

    def close(self) -> None:
        """Let go of the file."""
        self._file.close()

    def log_new(self) -> None:
        """What has been written since; the whole path twice a second at most."""
        places = self._file.read()
        for place in places:
            self._path.add(place)
            self._viewer.log_place(self._robot, place)
        if places and time.monotonic() - self._drawn_s >= _DRAW_PATH_EVERY_S:
            self._drawn_s = time.monotonic()
            self._viewer.log_path(self._robot, places[-1].unix_time_ns, self._path.strips)

    def log_all(self) -> None:
        """All of a path that is finished, its line growing by the second."""
        places = self._file.read()
        for number, place in enumerate(places):
            self._path.add(place)
            self._viewer.log_place(self._robot, place)
            if number % 10 == 0 or number == len(places) - 1:
                self._viewer.log_path(self._robot, place.unix_time_ns, self._path.strips)
