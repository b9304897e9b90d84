"""What a person wants to know of the last decisions, kept up to date sample by sample."""

from collections import deque
from dataclasses import dataclass

from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage

from mbot_protocol.beat.stages import SPANS, percentile, span_ms
from mbot_protocol.v1.messages_pb2 import Decision
from mbot_workstation.fleet.telemetry.stream import Sample

WINDOW = 100
"""Decisions that latencies and the rate are taken over: 40 s at 2.5 Hz."""


@dataclass(frozen=True, slots=True)
class SpanSummary:
    """One span of `SPANS` over the window, in ms; `count` decisions had it."""

    name: str
    p50_ms: float
    p99_ms: float
    count: int


class TelemetryWindow:
    """The last decisions of one robot session.

    Attributes:
        newest: the latest decision, None before the first one.
        picture: the latest observation, None before the first one.
        camera: the latest picture of the camera, None before the first one.
        lost: records of this session that never arrived, by gaps in their numbers.
        restarts: how often the robot's daemon has begun a new session meanwhile.

    """

    def __init__(self) -> None:
        self.newest: Decision | None = None
        self.picture: CompressedImage | None = None
        self.camera: CompressedImage | None = None
        self.lost = 0
        self.restarts = 0
        self._samples: deque[tuple[float, dict[str, float]]] = deque(maxlen=WINDOW)

    def add(self, sample: Sample) -> None:
        """Take in one sample; a new session of the robot starts the window over."""
        message = sample.message
        if isinstance(message, CompressedImage):
            if sample.of_camera:
                self.camera = message
            else:
                self.picture = message
            return
        if self.newest is not None:
            if message.session_id != self.newest.session_id:
                self._samples.clear()
                self.lost = 0
                self.restarts += 1
            else:
                self.lost += max(0, message.sequence - self.newest.sequence - 1)
        self.newest = message
        # By the robot's own clock: the first ones arrive together, whenever they were made.
        self._samples.append((message.started_monotonic_ns / 1e9, span_ms(message)))

    @property
    def decisions_per_s(self) -> float | None:
        """The rate of the decisions that arrived; None before there are two."""
        if len(self._samples) < 2:
            return None
        elapsed_s = self._samples[-1][0] - self._samples[0][0]
        return (len(self._samples) - 1) / elapsed_s if elapsed_s > 0 else None

    def summaries(self) -> list[SpanSummary]:
        """The spans that happened in the window."""
        found: list[SpanSummary] = []
        for name in (span.name for span in SPANS):
            values = [spans[name] for _, spans in self._samples if name in spans]
            if values:
                found.append(
                    SpanSummary(
                        name, percentile(values, 0.50), percentile(values, 0.99), len(values)
                    )
                )
        return found
