"""Telemetry off the control path: it hears of every tick, and a thread encodes and publishes them.

What the thread cannot keep up with is dropped, oldest first, and counted.
"""

import logging
import queue
import threading
from collections.abc import Callable
from typing import Protocol, Self

import cv2
import numpy as np
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage

from mbot_agent import configuration
from mbot_agent.tick import Tick
from mbot_protocol.beat.beat import Beat
from mbot_protocol.drive.picture import Picture
from mbot_protocol.v1.messages_pb2 import Decision
from mbot_protocol.wire.keys import CAMERA, DECISION, OBSERVATION, Topic

log = logging.getLogger(__name__)

BACKLOG = 4
"""Ticks waiting to be sent; at 2.5 Hz the oldest is then 1.6 s late and worth nothing."""

JPEG_QUALITY = 90

CAMERA_WIDTH_PX = 320
CAMERA_JPEG_QUALITY = 75
"""For people: 8 to 15 kB a beat, where it would be 60 at the camera's size."""


class Publisher(Protocol):
    """Where encoded messages go."""

    def publish(self, topic: Topic, payload: bytes) -> None:
        """Send one message, or drop it when the link is slow."""
        ...

    def is_watched(self, topic: Topic) -> bool:
        """Whether anybody listens now."""
        ...


class Telemetry:
    """The publishing thread. A context manager."""

    def __init__(
        self,
        publisher: Publisher,
        to_beat: Callable[[Tick], Beat],
        settings: configuration.Telemetry,
        glance: Callable[[], Picture | None],
    ) -> None:
        """Prepare; `glance` gives the camera's newest frame: (height, width, 3), uint8, RGB."""
        self._publisher = publisher
        self._pictures = settings.pictures
        self._to_beat = to_beat
        self._glance = glance
        self._backlog: queue.Queue[Tick | None] = queue.Queue(BACKLOG)
        self._dropped = 0
        self._thread = threading.Thread(target=self._run, name="telemetry", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        self._put(None)
        self._thread.join(timeout=1.0)

    def offer(self, tick: Tick) -> None:
        """Hand over a tick; returns at once."""
        self._put(tick)

    def _put(self, tick: Tick | None) -> None:
        while True:
            try:
                self._backlog.put_nowait(tick)
                return
            except queue.Full:
                self._drop_oldest()

    def _drop_oldest(self) -> None:
        try:
            self._backlog.get_nowait()
        except queue.Empty:
            return
        self._dropped += 1

    def _run(self) -> None:
        while (tick := self._backlog.get()) is not None:
            try:
                self._send(tick)
            except Exception:
                log.exception("a telemetry record was lost")

    def _send(self, tick: Tick) -> None:
        decision = self._to_beat(tick).decision
        decision.dropped_records = self._dropped
        self._publisher.publish(DECISION, decision.SerializeToString())
        if tick.observation is not None and self._shows_pictures():
            picture = _compressed(tick.observation, decision)
            self._publisher.publish(OBSERVATION, picture.SerializeToString())
        self._send_camera(decision)

    def _send_camera(self, decision: Decision) -> None:
        """What the camera sees, smaller, while somebody looks: not what was decided on."""
        if self._pictures is False or not self._publisher.is_watched(CAMERA):
            return
        if (frame := self._glance()) is not None:
            height_px, width_px = frame.shape[:2]
            scale = min(1.0, CAMERA_WIDTH_PX / width_px)
            size = (round(width_px * scale), max(1, round(height_px * scale)))
            small = cv2.resize(frame, size, interpolation=cv2.INTER_AREA)
            picture = _compressed(np.asarray(small, np.uint8), decision, CAMERA_JPEG_QUALITY)
            self._publisher.publish(CAMERA, picture.SerializeToString())

    def _shows_pictures(self) -> bool:
        """Pictures cost most of what telemetry does, and not everybody wants to be filmed."""
        if isinstance(self._pictures, bool):
            return self._pictures
        return self._publisher.is_watched(OBSERVATION)


def _compressed(
    picture: Picture, decision: Decision, quality: int = JPEG_QUALITY
) -> CompressedImage:
    """A picture, shape (height, width, 3), uint8, RGB, as a JPEG."""
    bgr = cv2.cvtColor(picture, cv2.COLOR_RGB2BGR)
    _, jpeg = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, quality])
    message = CompressedImage(frame_id=decision.robot_id, format="jpeg", data=jpeg.tobytes())
    message.timestamp.FromNanoseconds(decision.unix_time_ns)
    return message
