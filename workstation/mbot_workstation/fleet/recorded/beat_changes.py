"""Lines for people, of telemetry: what has changed from one beat to the next."""

from mbot_protocol.v1.messages_pb2 import Decision
from mbot_workstation.wording import decision_state, one_line, short_digest


def changes(before: Decision | None, now: Decision) -> list[tuple[str, str]]:
    """Level and words of what is new: model, state, faults, stops."""
    found: list[tuple[str, str]] = []
    if before is None or before.model_sha256 != now.model_sha256:
        found.append(("INFO", f"model {short_digest(now.model_sha256)}"))
    if before is None or before.state != now.state:
        found.append(("INFO", f"now {decision_state(now)}"))
    known = {fault.kind for fault in before.faults} if before is not None else set[str]()
    found += [
        ("ERROR", f"{one_line(fault.kind)}: {one_line(fault.detail)}")
        for fault in now.faults
        if fault.kind not in known
    ]
    if before is not None and before.stop_count != now.stop_count:
        found.append(("WARN", f"stop {now.stop_count}"))
    return found
