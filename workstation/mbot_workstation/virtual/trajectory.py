"""The robot's path as JSON lines, for drawing it later."""

import json
import time
from pathlib import Path
from typing import Self

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.virtual.live_world import TaskEvent, WorldStatus


class TrajectoryWriter:
    """Writes a line a moment: `t`, `unix_s`, `x`, `y`, `yaw`; `object` [x, y, yaw] and its
    `colour` [red, green, blue] if there is one.

    In s, m and rad; `t` is the simulation's time, `unix_s` the wall clock's, as in recordings.
    Lines are there for others to read as soon as they are written.

    What the task counts becomes a line with `t`, `event` and `score`.
    """

    def __init__(self, path: Path) -> None:
        """Begin the file.

        Raises:
            ConfigurationError: it can't be written.

        """
        try:
            self._file = path.open("w", encoding="utf-8", buffering=1)
        except OSError as error:
            raise ConfigurationError(
                f"can't write the trajectory to {path}: {error.strerror}"
            ) from None

    def add(self, status: WorldStatus) -> None:
        """Append where everything is."""
        robot = status.robot
        line: dict[str, object] = {
            "t": round(status.time_s, 3),
            "unix_s": round(time.time(), 3),
            "x": round(robot.x_m, 4),
            "y": round(robot.y_m, 4),
            "yaw": round(robot.yaw_rad, 4),
        }
        if status.objects:
            one = status.objects[0]
            line["object"] = [round(v, 4) for v in (one.x_m, one.y_m, one.yaw_rad)]
            if status.colours:
                line["colour"] = status.colours[0]
        self._write(line)

    def add_event(self, event: TaskEvent) -> None:
        """Append what has happened."""
        self._write(
            {
                "t": round(event.time_s, 3),
                "event": event.happening,
                "score": round(event.score, 4),
            }
        )

    def _write(self, line: dict[str, object]) -> None:
        self._file.write(json.dumps(line) + "\n")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()
