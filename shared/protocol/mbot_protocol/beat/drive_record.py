"""One beat of a drive as plain numbers: what the robot writes, and everybody reads.

It stands in recordings and live viewers as JSON beside `mbot.v1.Decision`, so that any viewer plots
it and any language reads it without our schema. In a robot's own recording it also holds what a
replay needs and telemetry lacks.
"""

from typing import Any

import msgspec
from msgspec import UNSET, UnsetType

from mbot_protocol.drive.actions import MotorMap, WheelMaps
from mbot_protocol.v1.messages_pb2 import Decision, State

SCHEMA_NAME = "mbot.DriveRecord"

DECISION_TOPIC, DRIVE_TOPIC = "decision", "drive"
OBSERVATION_TOPIC, CAMERA_TOPIC, LOG_TOPIC = "observation", "camera", "log"
POSE_TOPIC = "pose"

ROBOT_METADATA = "mbot.robot"
"""The metadata record of a recording that says which robot it was: `RobotFacts` as strings."""

_SIDES = ("left", "right")


class DriveRecord(msgspec.Struct, frozen=True):
    """One beat. What is left out did not happen.

    Attributes:
        sequence: as in Decision.
        state: idle, running, stopped, manual, fault.
        action_left, action_right: what the policy answered, not yet clipped.
        steps_left, steps_right: the same in motor steps, -250..250.
        duty_left, duty_right: what the wheels were told, by the policy or by hand, in [-1, 1];
            releases of before do not tell.
        board_m1, board_m2: the same at the motors, in 255ths (`WheelMaps.levels`).
        acknowledged: whether the board has confirmed that in time.
        picture_age_ms: of the frame when the beat began.
        late_ms, observe_ms, decide_ms, write_ms, acknowledge_ms: how long each stage took.
        frame_to_motors_ms: from the frame's capture to the command at the serial port.
        missed_ticks, stop_count, dropped_records: counted since the daemon's start; the last
            are beats that this recording lacks because the card, or the link, was too slow.
        cpu_temperature_c, load_1min, resident_memory_bytes: of the robot's computer and its daemon.
        armed: whether the wheels may turn without anybody saying more. This and the following the
            robot's own recordings have only.
        began_anew: the policy was asked with its memory zeroed.
        told_left, told_right: what the policy was told that the wheels did before, [-1, 1].
        memory: what the policy went on with, float32, little endian, shape as the model's.
        view_horizontal_deg, view_vertical_deg: the field of view that the policy's picture shows.

    """

    sequence: int
    state: str
    action_left: float | UnsetType = UNSET
    action_right: float | UnsetType = UNSET
    steps_left: int | UnsetType = UNSET
    steps_right: int | UnsetType = UNSET
    duty_left: float | UnsetType = UNSET
    duty_right: float | UnsetType = UNSET
    board_m1: int = 0
    board_m2: int = 0
    acknowledged: bool = False
    picture_age_ms: float | UnsetType = UNSET
    late_ms: float = 0.0
    observe_ms: float | UnsetType = UNSET
    decide_ms: float | UnsetType = UNSET
    write_ms: float | UnsetType = UNSET
    acknowledge_ms: float | UnsetType = UNSET
    frame_to_motors_ms: float | UnsetType = UNSET
    missed_ticks: int = 0
    stop_count: int = 0
    dropped_records: int = 0
    cpu_temperature_c: float | UnsetType = UNSET
    load_1min: float | UnsetType = UNSET
    resident_memory_bytes: int | UnsetType = UNSET
    armed: bool | UnsetType = UNSET
    began_anew: bool | UnsetType = UNSET
    told_left: float | UnsetType = UNSET
    told_right: float | UnsetType = UNSET
    memory: bytes | UnsetType = UNSET
    view_horizontal_deg: float | UnsetType = UNSET
    view_vertical_deg: float | UnsetType = UNSET


def drive_record(decision: Decision) -> DriveRecord:
    """A beat's numbers, as far as telemetry tells of it."""
    asked, moved = decision.HasField("action"), decision.HasField("steps")
    told = decision.HasField("duty")
    started_ns, captured_ns = decision.started_monotonic_ns, decision.captured_monotonic_ns
    observed_ns, decided_ns = decision.observed_monotonic_ns, decision.decided_monotonic_ns
    written_ns = decision.written_monotonic_ns
    return DriveRecord(
        sequence=decision.sequence,
        state=State.Name(decision.state).removeprefix("STATE_").lower(),
        action_left=decision.action.left if asked else UNSET,
        action_right=decision.action.right if asked else UNSET,
        steps_left=decision.steps.left if moved else UNSET,
        steps_right=decision.steps.right if moved else UNSET,
        duty_left=round(decision.duty.left, 6) if told else UNSET,
        duty_right=round(decision.duty.right, 6) if told else UNSET,
        board_m1=decision.board_m1,
        board_m2=decision.board_m2,
        acknowledged=decision.acknowledged_monotonic_ns != 0,
        picture_age_ms=_span_ms(captured_ns, started_ns),
        late_ms=_span_ms(decision.due_monotonic_ns, started_ns) or 0.0,
        observe_ms=_span_ms(started_ns, observed_ns),
        decide_ms=_span_ms(observed_ns, decided_ns) if asked else UNSET,
        write_ms=_span_ms(decided_ns or started_ns, written_ns),
        acknowledge_ms=_span_ms(written_ns, decision.acknowledged_monotonic_ns),
        frame_to_motors_ms=_span_ms(captured_ns, written_ns),
        missed_ticks=decision.missed_ticks,
        stop_count=decision.stop_count,
        dropped_records=decision.dropped_records,
        cpu_temperature_c=_given(decision, "cpu_temperature_c"),
        load_1min=_given(decision, "load_1min"),
        resident_memory_bytes=_given(decision, "resident_memory_bytes"),
    )


def _span_ms(from_ns: int, to_ns: int) -> float | UnsetType:
    """Between two stages that both happened."""
    return round((to_ns - from_ns) / 1e6, 3) if from_ns and to_ns else UNSET


def _given(decision: Decision, name: str) -> Any:
    return getattr(decision, name) if decision.HasField(name) else UNSET


class RobotFacts(msgspec.Struct, frozen=True):
    """Whose recording this is, and what turns an action of its policy into the board's speeds.

    Attributes:
        robot_id, session_id: as in Decision.
        software_version: of mbot-agent.
        processor: what has computed; another one may differ in the last digits.
        decision_rate_hz: beats a second.
        wheels: how steps became the motors' duties; "left_trim" and the like in a file.

    """

    robot_id: str
    session_id: int
    software_version: str
    processor: str
    decision_rate_hz: float
    wheels: WheelMaps

    def to_strings(self) -> dict[str, str]:
        """As MCAP keeps metadata."""
        fields = msgspec.structs.asdict(self)
        for side in _SIDES:
            motor = msgspec.structs.asdict(getattr(self.wheels, side))
            fields |= {f"{side}_{name}": value for name, value in motor.items()}
        del fields["wheels"]
        return {name: str(value) for name, value in fields.items()}

    @classmethod
    def from_strings(cls, strings: dict[str, str]) -> "RobotFacts":
        """Read what `to_strings` wrote.

        Raises:
            ValueError: a value is missing or of another kind; it says which.

        """
        fields = {
            key: value.lower() if value in ("True", "False") else value
            for key, value in strings.items()
        }
        wheels = {
            side: {
                name: fields[key]
                for name in MotorMap.__struct_fields__
                if (key := f"{side}_{name}") in fields
            }
            for side in _SIDES
        }
        return msgspec.convert(fields | {"wheels": wheels}, cls, strict=False)


def topic(robot_id: str, name: str) -> str:
    """A recording's topic: "/mbot/mbot-1/drive"."""
    return f"/mbot/{robot_id}/{name}"


def drive_record_schema() -> bytes:
    """The JSON schema of `DriveRecord`, an object without references, as viewers expect it."""
    _, components = msgspec.json.schema_components([DriveRecord])
    schema: dict[str, Any] = components["DriveRecord"]
    return msgspec.json.encode(schema)
