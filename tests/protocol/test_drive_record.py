import json

import msgspec
import numpy as np
import pytest

from mbot_protocol.beat.drive_record import (
    DriveRecord,
    RobotFacts,
    drive_record,
    drive_record_schema,
    topic,
)
from mbot_protocol.drive.actions import MotorMap, WheelMaps
from mbot_protocol.v1.messages_pb2 import Decision, State, Steps, Wheels

FACTS = RobotFacts(
    robot_id="mbot-1",
    session_id=2**63 + 5,
    software_version="0.1.0",
    processor="aarch64",
    decision_rate_hz=2.5,
    wheels=WheelMaps(MotorMap(trim=0.9, dead_band=41), MotorMap(dead_band=0)),
)


def test_an_action_comes_back_to_the_last_bit() -> None:
    for value in np.random.default_rng(1).uniform(-1, 1, 200).astype(np.float32):
        record = DriveRecord(1, "running", action_left=float(value), memory=value.tobytes())
        assert msgspec.json.decode(msgspec.json.encode(record), type=DriveRecord) == record


def test_the_schema_is_what_viewers_read() -> None:
    schema = json.loads(drive_record_schema())
    assert schema["type"] == "object"
    kinds = {name: field["type"] for name, field in schema["properties"].items()}
    assert kinds["action_left"] == "number"
    assert kinds["board_m1"] == "integer"
    assert set(kinds) == set(DriveRecord.__struct_fields__)
    assert "$ref" not in drive_record_schema().decode()


def test_a_standing_wheel_is_a_number_and_what_did_not_happen_is_left_out() -> None:
    written = json.loads(msgspec.json.encode(DriveRecord(1, "idle")))
    assert written["board_m1"] == 0
    assert "action_left" not in written


def test_the_robot_is_told_in_strings() -> None:
    told = FACTS.to_strings()
    assert (told["left_reversed"], told["left_trim"], told["right_dead_band"]) == (
        "True",
        "0.9",
        "0",
    )
    assert RobotFacts.from_strings(told | {"of_a_later_release": "x"}) == FACTS
    with pytest.raises(ValueError, match=r"wheels\.left\.trim"):
        RobotFacts.from_strings(FACTS.to_strings() | {"left_trim": "much"})
    with pytest.raises(ValueError, match="robot_id"):
        RobotFacts.from_strings({})


def test_a_beat_of_telemetry_becomes_the_same_numbers() -> None:
    decision = Decision(
        sequence=3,
        state=State.STATE_RUNNING,
        captured_monotonic_ns=1_000_000_000,
        due_monotonic_ns=1_039_000_000,
        started_monotonic_ns=1_040_000_000,
        observed_monotonic_ns=1_042_500_000,
        decided_monotonic_ns=1_045_000_000,
        written_monotonic_ns=1_045_250_000,
        acknowledged_monotonic_ns=1_048_000_000,
        action=Wheels(left=0.5, right=-0.25),
        steps=Steps(left=125, right=-62),
        board_m1=-130,
        board_m2=-70,
        duty=Wheels(left=130 / 255, right=-70 / 255),
        missed_ticks=7,
        stop_count=8,
        dropped_records=9,
        cpu_temperature_c=51.5,
    )
    record = drive_record(decision)
    assert (record.sequence, record.state) == (3, "running")
    assert (record.action_left, record.action_right) == (0.5, -0.25)
    assert (record.steps_left, record.steps_right) == (125, -62)
    assert (record.board_m1, record.board_m2) == (-130, -70)
    assert (record.duty_left, record.duty_right) == (0.509804, -0.27451)
    decision.ClearField("duty")  # of a release of before
    assert drive_record(decision).duty_left is msgspec.UNSET
    assert (record.missed_ticks, record.stop_count, record.dropped_records) == (7, 8, 9)
    assert (record.picture_age_ms, record.late_ms, record.observe_ms) == (40, 1, 2.5)
    assert (record.decide_ms, record.write_ms, record.acknowledge_ms) == (2.5, 0.25, 2.75)
    assert record.frame_to_motors_ms == 45.25
    assert record.acknowledged
    written = json.loads(msgspec.json.encode(record))
    assert written["cpu_temperature_c"] == 51.5
    assert not {"load_1min", "armed", "memory", "told_left"} & set(written)


def test_of_a_robot_that_stands_no_stage_is_told() -> None:
    standing = Decision(state=State.STATE_IDLE, due_monotonic_ns=5, started_monotonic_ns=5)
    written = json.loads(msgspec.json.encode(drive_record(standing)))
    assert written["state"] == "idle"
    assert {name for name in written if name.endswith("_ms")} == {"late_ms"}
    assert "action_left" not in written


def test_topics_lie_below_the_robot() -> None:
    assert topic("mbot-1", "drive") == "/mbot/mbot-1/drive"
