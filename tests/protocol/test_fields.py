import json
import math
from typing import Any

import msgspec
import numpy as np
import pytest

from mbot_protocol.beat.beat import PolicyInput
from mbot_protocol.beat.fields import decision_fields, drive_numbers, drive_schema, state_word
from mbot_protocol.v1.messages_pb2 import Decision, Senses, State, Steps, Wheels

from ..workstation.samples import decision


def test_an_action_comes_back_to_the_last_bit() -> None:
    for value in np.random.default_rng(1).uniform(-1, 1, 200).astype(np.float32):
        beat = Decision(action=Wheels(left=float(value)))
        told = PolicyInput(True, False, float(value), 0.0, value.tobytes())
        written = msgspec.json.encode(drive_numbers(beat, told))
        assert json.loads(written)["action_left"] == value
        assert msgspec.json.decode(written, type=PolicyInput) == told


def test_the_schema_is_what_viewers_read_and_names_all_that_is_written() -> None:
    schema = json.loads(drive_schema())
    assert schema["type"] == "object"
    kinds = {name: field["type"] for name, field in schema["properties"].items()}
    assert kinds["action_left"] == "number"
    assert kinds["board_m1"] == "integer"
    assert kinds["state"] == "string"
    told = PolicyInput(True, False, 0.0, 0.0, b"", 55.3, 42.9)
    said = decision()
    said.under_voltage, said.duty.left = False, 0.5
    said.senses.supply_v = 5.0
    said.held_ms, said.wrong_ms, said.would_have_done.left = 1, 3000, 0.5
    assert set(kinds) == set(drive_numbers(said, told))
    assert "$ref" not in drive_schema().decode()


def test_a_standing_wheel_is_a_number_and_what_did_not_happen_is_left_out() -> None:
    written = drive_numbers(Decision())
    assert written["board_m1"] == 0
    assert "action_left" not in written


@pytest.mark.parametrize(("state", "word"), [(State.STATE_RUNNING, "running"), (77, "state-77")])
def test_a_state_is_one_word(state: Any, word: str) -> None:
    assert drive_numbers(Decision(state=state))["state"] == state_word(state) == word


def test_a_beat_becomes_numbers() -> None:
    beat = Decision(
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
        missed_ticks=7,
        stop_count=8,
        dropped_records=9,
        cpu_temperature_c=51.5,
    )
    assert json.loads(msgspec.json.encode(drive_numbers(beat))) == {
        "sequence": 3,
        "state": "running",
        "action_left": 0.5,
        "action_right": -0.25,
        "steps_left": 125,
        "steps_right": -62,
        "board_m1": -130,
        "board_m2": -70,
        "missed_ticks": 7,
        "stop_count": 8,
        "dropped_records": 9,
        "hand_let_go": False,
        "cpu_temperature_c": 51.5,
        "acknowledged": True,
        "picture_age_ms": 40,
        "late_ms": 1,
        "observe_ms": 2.5,
        "decide_ms": 2.5,
        "write_ms": 0.25,
        "acknowledge_ms": 2.75,
        "frame_to_motors_ms": 45.25,
    }


def test_of_a_robot_that_stands_no_stage_is_told() -> None:
    standing = Decision(state=State.STATE_IDLE, due_monotonic_ns=5, started_monotonic_ns=5)
    written = drive_numbers(standing)
    assert written["state"] == "idle"
    assert {name for name in written if name.endswith("_ms")} == {"late_ms"}
    assert "action_left" not in written


def test_while_a_hand_drives_writing_counts_from_the_start() -> None:
    by_hand = Decision(started_monotonic_ns=1_000_000, written_monotonic_ns=1_500_000)
    assert drive_numbers(by_hand)["write_ms"] == 0.5


def test_json_names_are_stable() -> None:
    fields = json.loads(json.dumps(decision_fields(decision(5))))
    assert set(fields) == {
        "robot_id", "session_id", "sequence", "unix_time_ns", "state", "hand_let_go", "faults",
        "started_monotonic_ns", "captured_ms", "due_ms", "observed_ms", "decided_ms",
        "written_ms", "acknowledged_ms", "action_left", "action_right", "step_left",
        "step_right", "board_m1", "board_m2", "model_sha256", "missed_ticks",
        "cpu_temperature_c", "load_1min", "resident_memory_bytes", "dropped_records",
        "notices", "stop_count", "steps_left", "steps_right", "under_voltage", "duty_left",
        "duty_right", "senses_distance_m", "senses_floor_1", "senses_floor_2", "senses_edge",
        "senses_obstacle", "senses_supply_v",
        "driven_by", "held_ms", "would_have_done_left", "would_have_done_right",
        "wrong_ms", "wrong_says",
    }  # fmt: skip
    assert fields["session_id"] == "0000000000000001"
    assert fields["captured_ms"] == -30.0
    assert fields["state"] == "running"
    assert fields["step_left"] == fields["steps_left"] == 125
    standing = decision_fields(Decision())
    assert (standing["step_left"], standing["steps_left"]) == (0, None)


def test_json_is_null_where_the_robot_said_nothing() -> None:
    fields = decision_fields(Decision(schema_version=1))
    for name in ("action_left", "decided_ms", "model_sha256", "cpu_temperature_c", "load_1min"):
        assert fields[name] is None
    assert not any(isinstance(v, float) and math.isnan(v) for v in fields.values())


def test_what_a_board_does_not_feel_is_not_known() -> None:
    known = decision_fields(Decision(senses=Senses(distance_m=4.0)))
    assert (known["senses_distance_m"], known["senses_edge"]) == (4.0, False)
    assert known["senses_supply_v"] is None
    assert decision_fields(Decision())["senses_edge"] is None
    assert "senses_edge" not in drive_numbers(Decision())


def test_a_supply_that_sags_is_told_and_what_is_not_known_is_not() -> None:
    for known in (True, False):
        assert decision_fields(Decision(under_voltage=known))["under_voltage"] is known
        assert drive_numbers(Decision(under_voltage=known))["under_voltage"] is known
    assert decision_fields(Decision())["under_voltage"] is None
    assert "under_voltage" not in drive_numbers(Decision())
