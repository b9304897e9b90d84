"""What the page shows of a robot: its own words for everything, so that the page only draws."""

from mbot_protocol.beat.beat import Beat
from mbot_protocol.beat.fields import state_word
from mbot_protocol.v1.messages_pb2 import Decision, State, Status
from mbot_workstation.fleet.telemetry.window import TelemetryWindow
from mbot_workstation.wording import (
    computer_words,
    duration,
    fault_lines,
    one_line,
    senses_words,
    short_digest,
    standing_words,
    stop_words,
)

SILENT_AFTER_S = 1.5
"""Asked four times a second: by then what is shown is no longer now."""

_HEADLINES = {
    State.STATE_IDLE: "Standing: started, and not told to drive yet",
    State.STATE_RUNNING: "The policy drives",
    State.STATE_MANUAL: "Driven by hand",
    State.STATE_FAULT: "Told to drive, but something is in the way; motors are off",
}


def page_state(
    robot_id: str,
    status: Status | None,
    window: TelemetryWindow,
    *,
    silence_s: float,
    problem: str,
) -> dict[str, object]:
    """The page's state message.

    Args:
        robot_id: the robot.
        status: its last answer, if there was one.
        window: its telemetry.
        silence_s: since that answer.
        problem: why it does not answer; empty if it does.

    """
    lost = _lost(status, silence_s, problem)
    shown: dict[str, object] = {"kind": "state", "robot": robot_id, "lost": lost}
    if status is None:
        return shown | {"state": "unknown", "headline": "Not known", "run_refused": lost}
    model = status.active_model
    return shown | {
        "state": "unknown" if lost else state_word(status.state),
        "headline": "Not known: what follows is old" if lost else _headline(status, window.newest),
        "faults": fault_lines(status.faults),
        "notices": fault_lines(status.notices),
        "stop_count": status.last_stop.count,
        "stop_words": stop_words(status),
        "run_refused": lost or _why_not_run(status),
        "model": f"{one_line(model.name)} {short_digest(model.sha256)}" if model.sha256 else "",
        "model_sha256": model.sha256,
        "on_trial": bool(model.sha256) and not model.proven,
        "facts": _facts(status, window),
        "wheels": _wheels(window.newest),
    }


def _lost(status: Status | None, silence_s: float, problem: str) -> str:
    if status is None or (problem and silence_s > SILENT_AFTER_S):
        return problem or "not known yet"
    if silence_s > SILENT_AFTER_S:
        return f"no answer from the robot since {duration(silence_s)}"
    return ""


def _headline(status: Status, newest: Decision | None) -> str:
    if status.state == State.STATE_MANUAL and newest is not None and newest.driven_by:
        return f"Driven by hand by {one_line(newest.driven_by)}"
    if status.state == State.STATE_STOPPED:
        return f"Standing, {standing_words(status)}"
    return _HEADLINES.get(status.state, state_word(status.state))


def _why_not_run(status: Status) -> str:
    """Why `run` would do nothing, or be refused; the robot has the last word."""
    if status.state == State.STATE_RUNNING:
        return "the policy drives already"
    return "; ".join(one_line(fault.detail) for fault in status.faults)


def _wheels(decision: Decision | None) -> dict[str, float] | None:
    """What the wheels were told last, in [-1, 1], whoever told them."""
    if decision is None:
        return None
    left, right = Beat(decision).at_wheels()
    return {"left": left, "right": right}


def _facts(status: Status, window: TelemetryWindow) -> list[list[str]]:
    """Rows of a table: name, value."""
    rate = window.decisions_per_s
    decision = window.newest
    spans = {found.name: found for found in window.summaries()}
    rows = [
        ["decisions", f"{status.decisions}, {'-' if rate is None else f'{rate:.2f}'}/s"],
        ["missed", str(status.missed_ticks)],
    ]
    if (span := spans.get("frame to motors")) is not None:
        rows.append(["frame to motors", f"{span.p50_ms:.0f} ms, 99 %: {span.p99_ms:.0f} ms"])
    if decision is not None and (words := computer_words(decision)):
        rows.append(["computer", words])
    if status.HasField("senses"):
        rows.append(["senses", senses_words(status.senses)])
    board = one_line(status.board_version) or "not connected"
    guard = "" if status.board_has_deadman or not status.board_version else " (no dead-man)"
    if status.last_stop.count:  # which begins at 1
        rows.append(["stops", f"{status.last_stop.count - 1} since its start"])
    rows += [
        ["board", board + guard],
        ["camera", one_line(status.camera)],
        ["software", one_line(status.software_version)],
    ]
    return rows
