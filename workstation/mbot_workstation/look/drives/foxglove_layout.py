"""A layout for Foxglove and Lichtblick, which both import the same file: one robot's panels.

It fits a live robot (`view --foxglove`), what `telemetry --record` made, and a recording from the
robot's card: all three have the same topics.
"""

import json
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from mbot_protocol.beat.channels import CAMERA_TOPIC, DRIVE_TOPIC, LOG_TOPIC, OBSERVATION_TOPIC
from mbot_protocol.beat.channels import topic as topic_of
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.files import atomic_file

_LEFT, _RIGHT, _OTHER, _FOURTH = "#2f6fb2", "#d9772b", "#2c8a4b", "#8a4fb2"

Line = tuple[str, str]
"""A field of `DriveRecord`, and a colour."""

ACTION: tuple[Line, ...] = (("action_left", _LEFT), ("action_right", _RIGHT))
STEPS: tuple[Line, ...] = (("steps_left", _LEFT), ("steps_right", _RIGHT))
LATENCIES: tuple[Line, ...] = (
    ("frame_to_motors_ms", _LEFT),
    ("decide_ms", _RIGHT),
    ("late_ms", _OTHER),
    ("acknowledge_ms", _FOURTH),
)
COUNTERS: tuple[Line, ...] = (
    ("missed_ticks", _LEFT),
    ("dropped_records", _RIGHT),
    ("stop_count", _OTHER),
)


def layout(robot_id: str) -> dict[str, Any]:
    """The file's contents: pictures and log on the left, plots on the right."""
    camera, policy = (topic_of(robot_id, name) for name in (CAMERA_TOPIC, OBSERVATION_TOPIC))
    return {
        "configById": {
            "Image!camera": _image(camera, "camera, live only"),
            "Image!policy": _image(policy, "as the policy sees"),
            "RosOut!log": {
                "searchTerms": [],
                "minLogLevel": 1,
                "topicToRender": topic_of(robot_id, LOG_TOPIC),
                "foxglovePanelTitle": "state, faults, stops",
            },
            "Plot!action": _plot(robot_id, ACTION, "action of the policy, 1 is full speed"),
            "Plot!steps": _plot(robot_id, STEPS, "motor steps, -250 to 250"),
            "Plot!latency": _plot(robot_id, LATENCIES, "latency, ms"),
            "Plot!counters": _plot(robot_id, COUNTERS, "missed beats, lost records, stops"),
        },
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": _side_by_side(
            _stack(_side_by_side("Image!camera", "Image!policy"), "RosOut!log", 60),
            _stack(_stack("Plot!action", "Plot!steps"), _stack("Plot!latency", "Plot!counters")),
        ),
    }


def layout_text(robot_id: str) -> str:
    """The file."""
    return json.dumps(layout(robot_id), indent=2) + "\n"


def layout_file(robot_id: str) -> Path:
    """Write a robot's layout into the person's cache, where it may be replaced any time.

    Raises:
        ConfigurationError: it can't be written.

    """
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    path = Path(base) / "mbot-agent" / f"foxglove-{robot_id}.json"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        atomic_file.replace(path, layout_text(robot_id).encode())
    except OSError as error:
        raise ConfigurationError(f"can't write {path}: {error.strerror}") from None
    return path


def _image(picture_topic: str, title: str) -> dict[str, Any]:
    return {"imageMode": {"imageTopic": picture_topic}, "foxglovePanelTitle": title}


def _plot(robot_id: str, lines: Iterable[Line], title: str) -> dict[str, Any]:
    paths = [
        {
            "value": f"{topic_of(robot_id, DRIVE_TOPIC)}.{field}",
            "label": field,
            "color": color,
            "enabled": True,
            "timestampMethod": "receiveTime",
        }
        for field, color in lines
    ]
    return {
        "paths": paths,
        "xAxisVal": "timestamp",
        "followingViewWidth": 30,
        "isSynced": True,
        "showLegend": True,
        "legendDisplay": "floating",
        "foxglovePanelTitle": title,
    }


def _side_by_side(first: Any, second: Any, percent: int = 50) -> dict[str, Any]:
    return {"direction": "row", "first": first, "second": second, "splitPercentage": percent}


def _stack(first: Any, second: Any, percent: int = 50) -> dict[str, Any]:
    return {"direction": "column", "first": first, "second": second, "splitPercentage": percent}
