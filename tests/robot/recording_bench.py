"""Drives to be recorded without a robot: true ticks of the loop, and a look at what was written."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from mbot_agent import configuration
from mbot_agent.network.wire_messages import beat_of
from mbot_agent.recording.recording_directory import RecordingDirectory
from mbot_agent.recording.robot_facts import robot_facts
from mbot_agent.tick import Tick
from mbot_protocol.beat.beat import Beat
from mbot_protocol.beat.whole_chunks import WholeChunks
from mbot_protocol.policy.policy import Policy

from .loop_bench import Bench
from .tiny_models import counting_model

FACTS = robot_facts(configuration.Configuration(robot_id="mbot-1"), 42)


def directory(path: Path, **settings: Any) -> RecordingDirectory:
    limits: dict[str, Any] = {"leave_free_mb": 64.0} | settings
    return RecordingDirectory(path, configuration.Recording(**limits))


def to_beat(tick: Tick) -> Beat:
    return beat_of(tick, "mbot-1", 42, (), FACTS.wheels)


class Drive:
    """A loop that decides with a model with memory, on a picture that is another one each time."""

    def __init__(self) -> None:
        self.bench = Bench()
        self.bench.pilot.use(Policy(counting_model()))
        self._noise = np.random.default_rng(3)

    def tick(self) -> Tick:
        self.bench.camera.picture = self._noise.integers(0, 255, (240, 320, 3), np.uint8)
        return self.bench.tick()

    def ticks(self, count: int) -> Iterator[Tick]:
        return (self.tick() for _ in range(count))


def written(path: Path) -> dict[str, list[Any]]:
    """What a file holds by the last part of its topics; pictures as arrays, JSON decoded."""
    found: dict[str, list[Any]] = {"drive": [], "decision": [], "observation": [], "log": []}
    for message in WholeChunks(path).messages():
        name = message.topic.rpartition("/")[2]
        if name == "drive":
            found[name].append(json.loads(message.data))
        elif name == "observation":
            found[name].append(_picture(message.data))
        else:
            found[name].append(message.data)
    return found


def _picture(data: bytes) -> Any:
    from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage

    bgr = cv2.imdecode(np.frombuffer(CompressedImage.FromString(data).data, np.uint8), 1)
    assert bgr is not None
    return cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB)
