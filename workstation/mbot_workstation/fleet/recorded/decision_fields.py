"""A decision as one flat JSON object: stable names with units, for scripts and notebooks."""

from mbot_protocol.v1.messages_pb2 import Decision
from mbot_workstation.fleet.recorded.stage_times import stage_ms
from mbot_workstation.wording import state_word

Field = str | int | float | list[dict[str, str]] | None


def decision_fields(decision: Decision) -> dict[str, Field]:
    """The fields in a fixed order; null where the robot said nothing.

    Times of stages are in ms after the tick's start: the frame's capture is negative. The
    session is hexadecimal text, because it has more digits than JSON readers keep of a number.
    """
    asked, told = decision.HasField("action"), decision.HasField("duty")
    return {
        "robot_id": decision.robot_id,
        "session_id": f"{decision.session_id:016x}",
        "sequence": decision.sequence,
        "unix_time_ns": decision.unix_time_ns,
        "state": state_word(decision.state),
        "hand_let_go": decision.hand_let_go,
        "faults": [{"kind": f.kind, "detail": f.detail} for f in decision.faults],
        "started_monotonic_ns": decision.started_monotonic_ns,
        **{f"{stage}_ms": time_ms for stage, time_ms in stage_ms(decision).items()},
        "action_left": decision.action.left if asked else None,
        "action_right": decision.action.right if asked else None,
        "step_left": decision.steps.left,
        "step_right": decision.steps.right,
        "board_m1": decision.board_m1,
        "board_m2": decision.board_m2,
        "model_sha256": decision.model_sha256 or None,
        "missed_ticks": decision.missed_ticks,
        "cpu_temperature_c": (
            decision.cpu_temperature_c if decision.HasField("cpu_temperature_c") else None
        ),
        "load_1min": decision.load_1min if decision.HasField("load_1min") else None,
        "resident_memory_bytes": (
            decision.resident_memory_bytes if decision.HasField("resident_memory_bytes") else None
        ),
        "dropped_records": decision.dropped_records,
        "notices": [{"kind": n.kind, "detail": n.detail} for n in decision.notices],
        "duty_left": round(decision.duty.left, 6) if told else None,
        "duty_right": round(decision.duty.right, 6) if told else None,
    }
