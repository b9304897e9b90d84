"""What the virtual robot tells while it runs: for a person, or a JSON object a line."""

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TextIO

from mbot_workstation.tasks.task import Task
from mbot_workstation.virtual.live_world import TaskEvent, WorldStatus
from mbot_workstation.wording import typed


class LiveReport:
    """Writes to a stream, standard output if not told otherwise.

    With `as_json` every line is an object with a `type`: ready, status, event, board_stopped,
    played or result.
    """

    def __init__(self, *, as_json: bool, stream: TextIO | None = None) -> None:
        self._as_json = as_json
        self._stream = stream or sys.stdout

    def ready(self, board: str, camera: str, daemon_config: Path | None = None) -> None:
        """Board and camera are up; and there is a configuration for a daemon to drive them."""
        if self._as_json:
            self._json("ready", {"board": board, "camera": camera})
        else:
            self._text(f"ready: board {board}, camera {camera}")
            if daemon_config is not None:
                name = typed(daemon_config)
                self._text(
                    "next, in another terminal: `workstation keys new` (once), `workstation keys "
                    f"trust {name}`, `mbot-agent run --config {name}`"
                )

    def event(self, event: TaskEvent, task: Task) -> None:
        """The task has counted something."""
        if self._as_json:
            self._json(
                "event",
                {
                    "time_s": round(event.time_s, 3),
                    "happening": event.happening,
                    "score": round(event.score, 4),
                    "total_score": event.result["score"],
                    task.counted: event.result[task.counted],
                },
            )
        else:
            self._text(
                f"{event.time_s:7.1f} s  {event.happening:8}  {event.score:+.2f}  "
                f"({task.counted_done} {event.result[task.counted]}, "
                f"score {event.result['score']:.2f})"
            )

    def board_stopped(self, silent_ms: float) -> None:
        """The board has stopped its motors by itself, since nobody told it anything any more."""
        if self._as_json:
            self._json("board_stopped", {"silent_ms": round(silent_ms, 1)})
        else:
            self._text(
                f"the board stopped the motors by itself, {silent_ms:.0f} ms after the last "
                "command; is mbot-agent still alive?"
            )

    def status(self, status: WorldStatus, task: Task, frames: int, commands: int) -> None:
        """Where things are; a person sees only events."""
        if self._as_json:
            left, right = status.wheel_speeds_rad_s
            self._json(
                "status",
                {
                    "time_s": round(status.time_s, 3),
                    "x_m": round(status.robot.x_m, 4),
                    "y_m": round(status.robot.y_m, 4),
                    "yaw_rad": round(status.robot.yaw_rad, 4),
                    "wheel_speeds_rad_s": [round(left, 2), round(right, 2)],
                    "motors": [status.motors.m1, status.motors.m2],
                    "commands": commands,
                    "frames": frames,
                    task.counted: status.result[task.counted],
                    "score": status.result["score"],
                },
            )

    def played(self, rounds: int, pictures: int, commands: int) -> None:
        """A recording has been played to its end once more, and begins again."""
        if self._as_json:
            fields: dict[str, object] = {"rounds": rounds, "pictures": pictures}
            self._json("played", fields | {"commands": commands})
        else:
            times = "once" if rounds == 1 else f"{rounds} times"
            self._text(
                f"played {times}, {pictures} pictures; the board obeyed {commands} commands so far"
            )

    def result(self, result: Mapping[str, Any], task: Task) -> None:
        """The run is over."""
        if self._as_json:
            self._json("result", result)
            return
        self._text(
            f"{task.summary(result)}; drove {result['distance_driven_m']:.1f} m in "
            f"{result['duration_s']:.1f} s"
        )

    def _json(self, kind: str, fields: Mapping[str, object]) -> None:
        self._text(json.dumps({"type": kind, **fields}))

    def _text(self, line: str) -> None:
        print(line, file=self._stream, flush=True)
