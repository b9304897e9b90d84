"""A decision as flat JSON, by the names of its schema: a field of `Decision` is a field here.

A part of a message is named after both, `action_left`. There are two such objects: what
`telemetry --json` prints has all that is known, null where the robot said nothing; what stands in
recordings and live viewers beside the decision has numbers only, and leaves out what did not
happen, so that any viewer plots it and any language reads it without our schema.
"""

from collections.abc import Iterator
from typing import Any

import msgspec
from google.protobuf.descriptor import FieldDescriptor

from mbot_protocol.beat.beat import PolicyInput
from mbot_protocol.beat.stages import SPANS, span_ms, stage_ms
from mbot_protocol.v1.messages_pb2 import Decision, State

Field = str | int | float | bool | list[dict[str, str]] | None

DRIVE_SCHEMA_NAME = "mbot.DriveRecord"

_FLOATS = (FieldDescriptor.TYPE_FLOAT, FieldDescriptor.TYPE_DOUBLE)
_TIME = "_monotonic_ns"
_NOT_PLOTTED = ("schema_version", "session_id", "unix_time_ns")


def state_word(state: int) -> str:
    """`State` in one lower-case word; a state this software does not know by its number."""
    if state not in State.values():
        return f"state-{state}"
    return State.Name(State.ValueType(state)).removeprefix("STATE_").lower()


def decision_fields(decision: Decision) -> dict[str, Field]:
    """All of it; null where the robot said nothing.

    Times of stages are in ms after the tick's start: the frame's capture is negative. The
    session is hexadecimal text, because it has more digits than JSON readers keep of a number.
    """
    found: dict[str, Field] = {}
    stages = stage_ms(decision)
    for name, field, value in _leaves(decision):
        if field.message_type is not None:
            parts = [part.name for part in field.message_type.fields]
            found[name] = [{part: getattr(one, part) for part in parts} for one in value]
        elif name == "session_id":
            found[name] = f"{value:016x}"
        elif name.endswith(_TIME) and name != f"started{_TIME}":
            stage = name.removesuffix(_TIME)
            found[f"{stage}_ms"] = stages[stage]
        else:
            found[name] = None if value == "" else value
    found.pop("schema_version")
    # Older than the rule that names follow the schema; scripts read them.
    return found | {"step_left": decision.steps.left, "step_right": decision.steps.right}


def drive_numbers(decision: Decision, policy_input: PolicyInput | None = None) -> dict[str, Any]:
    """Numbers only; what is not there did not happen. `acknowledged`: by the board, in time."""
    found = {
        name: value
        for name, field, value in _leaves(decision)
        if _is_plotted(name, field) and value is not None
    }
    spans = span_ms(decision)
    times = {s.field: round(spans[s.name], 3) for s in SPANS if s.name in spans}
    if not decision.HasField("action"):
        times.pop("decide_ms", None)
    known: dict[str, Any] = msgspec.to_builtins(policy_input) if policy_input is not None else {}
    acknowledged = decision.acknowledged_monotonic_ns != 0
    return found | {"acknowledged": acknowledged, "late_ms": 0.0} | times | known


def drive_schema() -> bytes:
    """The JSON schema of `drive_numbers`, an object without references, as viewers expect it."""
    kinds = {
        name: "string" if field.enum_type else _kind(field)
        for name, field, _ in _leaves(Decision())
        if _is_plotted(name, field)
    }
    kinds |= {"acknowledged": "boolean"} | {span.field: "number" for span in SPANS}
    _, components = msgspec.json.schema_components([PolicyInput])
    properties: dict[str, Any] = {name: {"type": kind} for name, kind in kinds.items()}
    properties |= components["PolicyInput"]["properties"]
    return msgspec.json.encode({"title": "DriveRecord", "type": "object", "properties": properties})


def _leaves(decision: Decision) -> Iterator[tuple[str, Any, Any]]:
    """Name, descriptor and value of each field, and of each part of one message of it.

    A repeated field is a value of its own; None is what was not said.
    """
    for field in Decision.DESCRIPTOR.fields:
        value = getattr(decision, field.name)
        there = not field.has_presence or decision.HasField(field.name)
        if field.message_type is None or not field.has_presence:
            word = state_word(value) if field.enum_type else value
            yield field.name, field, word if there else None
        else:
            for part in field.message_type.fields:
                said = there and (not part.has_presence or value.HasField(part.name))
                known = getattr(value, part.name) if said else None
                yield f"{field.name}_{part.name}", part, known


def _is_plotted(name: str, field: Any) -> bool:
    is_number = field.type not in (FieldDescriptor.TYPE_STRING, FieldDescriptor.TYPE_MESSAGE)
    return is_number and not name.endswith(_TIME) and name not in _NOT_PLOTTED


def _kind(field: Any) -> str:
    if field.type == FieldDescriptor.TYPE_BOOL:
        return "boolean"
    return "number" if field.type in _FLOATS else "integer"
