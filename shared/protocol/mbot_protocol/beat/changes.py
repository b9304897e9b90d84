"""Lines for people: what has changed from one beat to the next."""

from typing import Literal

from mbot_protocol.beat.fields import state_word
from mbot_protocol.v1.messages_pb2 import Decision, LastStop, State

Level = Literal["INFO", "WARN", "ERROR"]


def decision_state(decision: Decision) -> str:
    """A beat's state, and why it stands if a hand has let go."""
    return state_word(decision.state) + (" (the hand let go)" if decision.hand_let_go else "")


def changes(
    before: Decision | None, now: Decision, last_stop: LastStop | None = None
) -> list[tuple[Level, str]]:
    """Level and words of what is new: model, state, faults, stops, missed beats.

    Args:
        before: the beat before; None: there was none.
        now: this one.
        last_stop: who or what stopped the robot, where that is known.

    Returns:
        Texts are the robot's: whoever prints them makes them safe.

    """
    if before is not None and before.session_id != now.session_id:
        before = None
    found: list[tuple[Level, str]] = []
    if before is None or before.model_sha256 != now.model_sha256:
        found.append(("INFO", f"model {now.model_sha256[:12] or 'none'}"))
    if before is None or before.state != now.state:
        level: Level = "WARN" if now.state == State.STATE_FAULT else "INFO"
        found.append((level, f"now {decision_state(now)}"))
    if now.driven_by and (before is None or before.driven_by != now.driven_by):
        found.append(("INFO", f"{now.driven_by} drives by hand"))
    if now.HasField("wrong_ms"):
        said = f"the {now.wrong_ms / 1000:.1f} s before were wrong, says"
        found.append(("WARN", f"{said} {now.wrong_says or 'somebody'}"))
    known = {fault.kind for fault in before.faults} if before is not None else set[str]()
    new = [fault for fault in now.faults if fault.kind not in known]
    found.extend(("ERROR", f"{fault.kind}: {fault.detail}") for fault in new)
    if before is not None and before.stop_count != now.stop_count:
        found.append(("WARN", _stop_words(last_stop)))
    if before is not None and before.missed_ticks != now.missed_ticks:
        found.append(("WARN", f"{now.missed_ticks - before.missed_ticks} beats missed"))
    return found


def _stop_words(stop: LastStop | None) -> str:
    if stop is None:
        return "stopped"
    return f"stopped: {stop.why}" if stop.why else f"stopped by {stop.by}"
