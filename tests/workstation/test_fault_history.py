"""`workstation faults`: what has kept robots from driving."""

import json
from pathlib import Path

import pytest

from mbot_protocol.beat.beat import Beat
from mbot_protocol.beat.recorded_drive import RecordedDrive
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.v1.messages_pb2 import Decision, Fault
from mbot_workstation.cli.support import faults
from mbot_workstation.look.collect import fault_history
from mbot_workstation.look.collect.fault_history import faults_in

from .called import output_of


def drive_with(*kinds_of_beats: tuple[str, ...]) -> RecordedDrive:
    """A beat a second, with these faults each."""
    beats = tuple(
        Beat(
            Decision(
                unix_time_ns=at * 1_000_000_000,
                faults=[Fault(kind=kind, detail=f"{kind} at {at}") for kind in kinds],
            )
        )
        for at, kinds in enumerate(kinds_of_beats, 1)
    )
    return RecordedDrive((Path("drives/mbot-1/drive-0001/000.mcap"),), None, beats)


def test_each_fault_has_its_beginning_and_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    made = drive_with((), ("stuck",), ("stuck", "edge"), ("edge",), (), ("stuck",))
    monkeypatch.setattr(fault_history, "read_drive", lambda _: made)
    found = [(one.kind, one.detail, one.lasted_s) for one in faults_in([Path("x")])]
    assert found == [
        ("stuck", "stuck at 6", 0.0),
        ("edge", "edge at 3", 2.0),
        ("stuck", "stuck at 2", 2.0),
    ]


def test_of_a_recorded_drive(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recorded = Path(__file__).parents[1] / "data" / "recorded-drive"
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ConfigurationError, match="recordings fetch --all"):
        output_of(faults)
    assert isinstance(json.loads(output_of(faults, recorded, "--json")), list)
    monkeypatch.setattr(fault_history, "read_drive", lambda _: drive_with(("stuck\x1b[2J",)))
    assert "\x1b" not in output_of(faults, recorded)
