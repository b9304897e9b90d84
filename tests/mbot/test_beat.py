"""Beats as a program reads them."""

from pathlib import Path

import numpy as np
import pytest

from mbot import Beat, ConfigurationError, read_recording
from mbot.beat import Beat as Same
from mbot_protocol.beat import beat as protocol
from mbot_protocol.v1.messages_pb2 import Decision, Fault, State, Wheels

RECORDED = Path(__file__).parents[1] / "data" / "recorded-drive"


def test_a_robots_recording_is_read_beat_by_beat() -> None:
    beats = list(read_recording(RECORDED))
    assert len(beats) == 13
    assert [beat.number for beat in beats] == sorted({beat.number for beat in beats})
    assert {beat.state for beat in beats} == {"running", "stopped"}
    driven = [beat.action for beat in beats if beat.action is not None]
    assert np.abs(driven).max() > 0
    frame = beats[0].frame
    assert frame is not None
    assert (frame.shape, frame.dtype) == ((64, 64, 3), np.uint8)
    assert beats[1].monotonic_s - beats[0].monotonic_s == pytest.approx(0.4, abs=0.05)
    assert next(iter(read_recording(str(RECORDED)))).raw == beats[0].raw


def test_what_was_not_said_is_none() -> None:
    decision = Decision(sequence=7, state=State.STATE_FAULT, unix_time_ns=1_500_000_000)
    decision.faults.append(Fault(kind="camera-lost", detail="no picture"))
    beat = Beat(protocol.Beat(decision))
    assert (beat.number, beat.state, beat.unix_s) == (7, "fault", 1.5)
    assert (beat.action, beat.frame, beat.faults) == (None, None, ("camera-lost: no picture",))
    decision.action.CopyFrom(Wheels(left=0.5, right=-0.5))
    assert beat.action == (0.5, -0.5)
    assert Beat is Same


def test_no_recording_is_said_at_once(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="holds no recording"):
        read_recording(tmp_path)
