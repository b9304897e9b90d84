"""What came of a demonstration, in figures."""

import json
from dataclasses import dataclass
from pathlib import Path

from mbot_protocol.beat.stages import percentile
from mbot_protocol.errors import MbotError
from mbot_protocol.v1.messages_pb2 import Decision, Status

SUCCESS_TOUCHES = 3


@dataclass(frozen=True, slots=True)
class DemoResult:
    """What came of it; times in ms, medians and 99th percentiles over the driving decisions.

    Attributes:
        decision_p50_ms, decision_p99_ms: start of a decision to the board's acknowledgement.
        frame_p50_ms, frame_p99_ms: frame captured to the board's acknowledgement.
        agent_cpu_share: of one core, while driving.
        push_s: push to active, the robot's dry run included.
        board_version: what the board's firmware calls itself.
        board_has_deadman: it stops by itself when the daemon falls silent.

    """

    touches: int
    driven_s: float
    distance_driven_m: float
    score: float
    decisions: int
    missed_ticks: int
    decision_p50_ms: float
    decision_p99_ms: float
    frame_p50_ms: float
    frame_p99_ms: float
    agent_cpu_share: float
    agent_memory_mb: float
    push_s: float
    board_version: str
    board_has_deadman: bool
    success: bool


def summarise(
    folder: Path,
    decisions: list[Decision],
    driven_s: float,
    cpu_share: float,
    push_s: float,
    board: Status,
) -> DemoResult:
    """What came of it, from the virtual robot's own result and what was recorded.

    Args:
        folder: of the demonstration.
        decisions: while driving, in their order.
        driven_s: how long that was.
        cpu_share: of one core, the daemon's meanwhile.
        push_s: push to active.
        board: the status that names its firmware.

    Raises:
        MbotError: no decision reached the board.

    """
    run = json.loads((folder / "result.json").read_text())
    answered = [d for d in decisions if d.acknowledged_monotonic_ns]
    if not answered:
        raise MbotError(f"the policy never drove, see {folder / 'agent.log'}")
    decision_ms = [(d.acknowledged_monotonic_ns - d.started_monotonic_ns) / 1e6 for d in answered]
    frame_ms = [(d.acknowledged_monotonic_ns - d.captured_monotonic_ns) / 1e6 for d in answered]
    missed = decisions[-1].missed_ticks - decisions[0].missed_ticks
    return DemoResult(
        touches=run["touches"],
        driven_s=round(driven_s, 1),
        distance_driven_m=run["distance_driven_m"],
        score=run["score"],
        decisions=len(decisions),
        missed_ticks=missed,
        decision_p50_ms=round(percentile(decision_ms, 0.50), 2),
        decision_p99_ms=round(percentile(decision_ms, 0.99), 2),
        frame_p50_ms=round(percentile(frame_ms, 0.50), 2),
        frame_p99_ms=round(percentile(frame_ms, 0.99), 2),
        agent_cpu_share=round(cpu_share, 4),
        agent_memory_mb=round(max(d.resident_memory_bytes for d in decisions) / 2**20, 1),
        push_s=round(push_s, 2),
        board_version=board.board_version,
        board_has_deadman=board.board_has_deadman,
        success=run["touches"] >= SUCCESS_TOUCHES,
    )
