"""Telemetry off the control path: the loop offers records, a thread encodes and publishes them.

What the thread cannot keep up with is dropped, oldest first, and counted.
"""

import logging
import queue
import threading
import time
from dataclasses import dataclass
from types import TracebackType
from typing import Protocol, Self

import cv2
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage

from mbot_agent.health import read_health
from mbot_protocol.keys import DECISION, OBSERVATION, Topic
from mbot_protocol.picture import Picture
from mbot_protocol.v1.messages_pb2 import Decision

log = logging.getLogger(__name__)

BACKLOG = 4
"""Records waiting to be sent; at 2.5 Hz the oldest is then 1.6 s late and worth nothing."""

JPEG_QUALITY = 90


@dataclass(frozen=True, slots=True)
class Record:
    """One tick: what was decided, and what the policy saw, shape (64, 64, 3), if anything."""

    decision: Decision
    observation: Picture | None


class Publisher(Protocol):
    """Where encoded messages go."""

    def publish(self, topic: Topic, payload: bytes) -> None:
        """Send one message, or drop it when the link is slow."""
        ...


class Telemetry:
    """The publishing thread. A context manager."""

    def __init__(self, publisher: Publisher) -> None:
        self._publisher = publisher
        self._backlog: queue.Queue[Record | None] = queue.Queue(BACKLOG)
        self._dropped = 0
        self._thread = threading.Thread(target=self._run, name="telemetry", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._put(None)
        self._thread.join(timeout=1.0)

    def offer(self, record: Record) -> None:
        """Hand over a record; returns at once."""
        self._put(record)

    def _put(self, record: Record | None) -> None:
        while True:
            try:
                self._backlog.put_nowait(record)
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
        while (record := self._backlog.get()) is not None:
            try:
                self._send(record)
            except Exception:
                log.exception("a telemetry record was lost")

    def _send(self, record: Record) -> None:
        decision = record.decision
        health = read_health()
        if health.cpu_temperature_c is not None:
            decision.cpu_temperature_c = health.cpu_temperature_c
        if health.load_1min is not None:
            decision.load_1min = health.load_1min
        if health.resident_memory_bytes is not None:
            decision.resident_memory_bytes = health.resident_memory_bytes
        decision.dropped_records = self._dropped
        decision.unix_time_ns = _unix_time_ns(decision.started_monotonic_ns)
        self._publisher.publish(DECISION, decision.SerializeToString())
        if record.observation is not None:
            picture = _to_message(record.observation, decision)
            self._publisher.publish(OBSERVATION, picture.SerializeToString())


def _unix_time_ns(monotonic_ns: int) -> int:
    return time.time_ns() - (time.monotonic_ns() - monotonic_ns)


def _to_message(observation: Picture, decision: Decision) -> CompressedImage:
    bgr = cv2.cvtColor(observation, cv2.COLOR_RGB2BGR)
    _, jpeg = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    message = CompressedImage(frame_id=decision.robot_id, format="jpeg", data=jpeg.tobytes())
    message.timestamp.FromNanoseconds(decision.unix_time_ns)
    return message
