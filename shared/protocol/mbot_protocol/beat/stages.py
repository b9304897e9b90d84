"""The stages of a decision, from the frame's capture to the board's acknowledgement."""

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from mbot_protocol.v1.messages_pb2 import Decision

STAGES = ("captured", "due", "observed", "decided", "written", "acknowledged")
"""The points in time of a decision besides its start, in order."""


class Span(NamedTuple):
    """From one stage to another: for people, in JSON, from, to."""

    name: str
    field: str
    start: str
    end: str


SPANS = (
    Span("frame age", "picture_age_ms", "captured", "started"),
    Span("tick late by", "late_ms", "due", "started"),
    Span("observe", "observe_ms", "started", "observed"),
    Span("decide", "decide_ms", "observed", "decided"),
    Span("write", "write_ms", "decided", "written"),
    Span("board reply", "acknowledge_ms", "written", "acknowledged"),
    Span("frame to motors", "frame_to_motors_ms", "captured", "written"),
)


def stage_ms(decision: Decision) -> dict[str, float | None]:
    """Each of `STAGES` in ms after the tick's start; None where a stage did not happen."""
    started_ns = _time_ns(decision, "started")
    return {
        stage: None
        if started_ns is None or (time_ns := _time_ns(decision, stage)) is None
        else (time_ns - started_ns) / 1e6
        for stage in STAGES
    }


def span_ms(decision: Decision) -> dict[str, float]:
    """The duration of each of `SPANS` that happened, in ms, by its name."""
    spans: dict[str, float] = {}
    for span in SPANS:
        start_ns, end_ns = _time_ns(decision, span.start), _time_ns(decision, span.end)
        if start_ns is None and span.name == "write":  # nobody decides while a hand drives
            start_ns = _time_ns(decision, "started")
        if start_ns is not None and end_ns is not None:
            spans[span.name] = (end_ns - start_ns) / 1e6
    return spans


def percentile(values: Iterable[float], share: float) -> float:
    """The smallest value that at least `share` of the values do not exceed (nearest rank).

    Raises:
        ValueError: there are no values, or the share is not in (0, 1].

    """
    ordered: Sequence[float] = sorted(values)
    if not ordered or not 0.0 < share <= 1.0:
        raise ValueError(f"no percentile {share!r} of {len(ordered)} values")
    return ordered[math.ceil(share * len(ordered)) - 1]


def _time_ns(decision: Decision, stage: str) -> int | None:
    time_ns: int = getattr(decision, f"{stage}_monotonic_ns")
    return time_ns or None
