"""Where a virtual robot is and was: its `--trajectory` file, read while it is being written."""

import json
import math
from collections import deque
from dataclasses import dataclass
from pathlib import Path

from mbot_protocol.errors import ConfigurationError

LONGEST_PATH = 2000
"""Points that are drawn live: 200 s at the file's rate; then the beginning is forgotten."""

_JUMP_M = 0.3
"""Between two points a robot drives 4 cm; further is somebody who carried it."""

Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class PathPoint:
    """One moment.

    Attributes:
        unix_time_ns: of the wall clock.
        robot: where it is, metres, x to the right and y up.
        yaw_rad: which way it looks, from x to the left.
        target: where the object is.

    """

    unix_time_ns: int
    robot: Point
    yaw_rad: float
    target: Point


class PathFile:
    """Reads on where it was; a line that is only half there is left for the next time."""

    def __init__(self, path: Path) -> None:
        """Open the file.

        Raises:
            ConfigurationError: it can't be read.

        """
        try:
            self._file = path.open("rb")
        except OSError as error:
            raise ConfigurationError(f"can't read the path in {path}: {error.strerror}") from None
        self._name = path
        self._rest = b""

    def close(self) -> None:
        """Let go of it."""
        self._file.close()

    def read(self) -> list[PathPoint]:
        """What is new; raises ConfigurationError if it is not a trajectory of ours."""
        *lines, self._rest = (self._rest + self._file.read()).split(b"\n")
        return [place for line in lines if (place := self._place(line)) is not None]

    def _place(self, line: bytes) -> PathPoint | None:
        try:
            fields = json.loads(line)
            if "event" in fields:
                return None
            time_s, x_m, y_m, yaw_rad = (float(fields[k]) for k in ("unix_s", "x", "y", "yaw"))
            target_x_m, target_y_m = (float(value) for value in fields["object"][:2])
        except (ValueError, KeyError, TypeError):
            raise ConfigurationError(
                f"{self._name} is not a path of `virtual-robot --trajectory`, or an older one: "
                f"{line[:60]!r}"
            ) from None
        if not all(map(math.isfinite, (time_s, x_m, y_m, yaw_rad, target_x_m, target_y_m))):
            raise ConfigurationError(f"{self._name} holds a value that is not finite")
        return PathPoint(round(time_s * 1e9), (x_m, y_m), yaw_rad, (target_x_m, target_y_m))


def read_path(path: Path) -> list[PathPoint]:
    """A whole file, as far as it is written; raises ConfigurationError as `PathFile`."""
    file = PathFile(path)
    try:
        return file.read()
    finally:
        file.close()


class DrivenPath:
    """The path so far, as lines to be drawn: a robot that is carried draws none."""

    def __init__(self, longest: int | None = LONGEST_PATH) -> None:
        """Begin; of a longer path the beginning is forgotten, unless it is None."""
        self._points: deque[Point] = deque(maxlen=longest)

    def add(self, place: PathPoint) -> None:
        """Take in one moment."""
        self._points.append(place.robot)

    @property
    def strips(self) -> list[list[Point]]:
        """Lines through points in their order."""
        found: list[list[Point]] = []
        for point in self._points:
            if not found or math.dist(found[-1][-1], point) > _JUMP_M:
                found.append([])
            found[-1].append(point)
        return found
