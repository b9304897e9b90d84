"""A live recording that lost records, and the robot's own."""

import json
import os
import shutil
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import pytest
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from mbot_agent.configuration import Recording as RecordingSettings
from mbot_agent.recording.recording_directory import RecordingDirectory
from mbot_agent.recording.recording_service import RecordingService
from mbot_protocol.beat.beat import Beat
from mbot_protocol.beat.recorded_drive import RecordedDrive, read_drive
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.cli.recordings import FillOptions
from mbot_workstation.cli.subcommands import app
from mbot_workstation.fleet.telemetry.telemetry_file import TelemetryFile
from mbot_workstation.look.drives.gap_filling import fill, gaps, write
from mbot_workstation.look.drives.replayed_drive import TOLERANCE, replay
from mbot_workstation.pictures.picture_file import encode_picture, observation

from .fake_robot import FakeRobot
from .samples import decision

RECORDED = Path(__file__).parents[1] / "data" / "recorded-drive"
MODEL = RECORDED / "seeing.onnx"
JPEG, PNG = b"live", b"exact"


def beats(*numbers: int, session: int = 1, encoded: bytes = JPEG) -> list[Beat]:
    exact = encoded == PNG
    return [Beat(decision(n, session), encoded=encoded, is_exact=exact) for n in numbers]


def robots_own(found: list[Beat]) -> RecordedDrive:
    return RecordedDrive((), None, tuple(found))


def keys(found: tuple[Beat, ...]) -> list[tuple[int, int]]:
    return [(beat.decision.session_id, beat.decision.sequence) for beat in found]


def test_gaps_are_between_beats_of_one_life() -> None:
    live = [*beats(3, 4, 7), *beats(0, 2, session=2)]
    assert [(gap.session_id, gap.first, gap.last) for gap in gaps(live)] == [(1, 5, 6), (2, 1, 1)]
    first = gaps(live)[0]
    assert first.from_unix_ns == live[1].decision.unix_time_ns
    assert first.until_unix_ns == live[2].decision.unix_time_ns
    hour_ns = 3_600_000_000_000
    assert first.may_be_in(first.from_unix_ns - hour_ns, first.from_unix_ns)
    assert not first.may_be_in(first.until_unix_ns + hour_ns, first.until_unix_ns + 2 * hour_ns)


def test_what_is_missing_is_taken_and_nothing_else() -> None:
    live = [*beats(3, 7), *beats(4, encoded=b"")]
    robots = [*beats(1, 3, 4, 5, 9, encoded=PNG), *beats(5, 6, session=2, encoded=PNG)]
    other = [replace(beat, decision=decision(6)) for beat in beats(6)]
    other[0].decision.robot_id = "mbot-2"
    found = fill(live, [robots_own([*robots, *other])])
    assert keys(found.beats) == [(1, 3), (1, 4), (1, 5), (1, 7)]
    assert [beat.encoded for beat in found.beats] == [PNG, PNG, PNG, JPEG]
    assert (found.decisions, found.pictures, found.still_missing) == (1, 1, 1)


@given(st.sets(st.integers(0, 40), min_size=2), st.sets(st.integers(0, 40)))
def test_whatever_was_lost_is_there_if_the_robot_has_it(live: set[int], robots: set[int]) -> None:
    found = fill(beats(*live), [robots_own(beats(*robots, encoded=PNG))])
    between = set(range(min(live), max(live) + 1))
    assert keys(found.beats) == [(1, n) for n in sorted(live | (robots & between))]
    assert found.decisions == len(robots & between - live)
    assert found.still_missing == len(between - live - robots)
    assert sum(gap.count for gap in gaps(found.beats)) == found.still_missing


@pytest.fixture
def torn(tmp_path: Path) -> Path:
    """The recorded drive as a link that lost four of its records would have brought it."""
    whole = read_drive(RECORDED).beats
    path = tmp_path / "torn.mcap"
    with TelemetryFile(path, "virtual") as recording:
        for beat in (beat for n, beat in enumerate(whole) if n not in (2, 5, 6, 9)):
            recording.write(beat.decision)
            if (seen := observation(beat)) is not None:
                jpeg = encode_picture(seen, ".jpg", 80)
                picture = CompressedImage(frame_id="virtual", format="jpeg", data=jpeg)
                picture.timestamp.FromNanoseconds(beat.decision.unix_time_ns)
                recording.write(picture)
    return path


def test_a_recording_with_dropped_records_is_whole_again(torn: Path, tmp_path: Path) -> None:
    before = torn.read_bytes()
    result = CliRunner().invoke(app, ["recordings", "fill", str(torn), "--from", str(RECORDED)])
    assert result.exit_code == 0, result.output
    assert "4 of 4 missing beats filled, 0 pictures added, 0 beats still missing" in result.output
    assert torn.read_bytes() == before
    there, whole = read_drive(tmp_path / "torn-filled.mcap"), read_drive(RECORDED)
    assert [b.decision for b in there.beats] == [b.decision for b in whole.beats]
    assert [b.encoded for b in there.beats] == [b.encoded for b in whole.beats]
    assert [b.policy_input for b in there.beats] == [b.policy_input for b in whole.beats]
    again = CliRunner().invoke(app, ["recordings", "fill", str(torn), "--from", str(RECORDED)])
    assert isinstance(again.exception, ConfigurationError)
    assert "exists already" in str(again.exception)
    filled = str(tmp_path / "torn-filled.mcap")
    nothing = CliRunner().invoke(app, ["recordings", "fill", filled])
    assert "nothing is missing" in nothing.output


def test_what_was_filled_can_be_replayed_and_what_was_not_can_not(
    torn: Path, tmp_path: Path
) -> None:
    with pytest.raises(ConfigurationError, match="cannot be replayed"):
        replay(read_drive(torn), [MODEL])
    filled = tmp_path / "filled.mcap"
    write(filled, fill(read_drive(torn).beats, [read_drive(RECORDED)]))
    found, original = (replay(read_drive(path), [MODEL]) for path in (filled, RECORDED))
    assert len(found.decisions) == len(original.decisions) == 12
    assert [one.action for one in found.decisions] == [one.action for one in original.decisions]
    assert found.is_as_expected == original.is_as_expected
    assert found.largest_difference <= TOLERANCE


def test_the_robot_is_asked_for_the_drives_that_may_have_it(
    torn: Path, robot: FakeRobot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    directory = RecordingDirectory(tmp_path / "card", RecordingSettings())
    began_s = read_drive(torn).beats[0].decision.unix_time_ns // 10**9
    for number, started_s in ((1, began_s), (2, began_s + 3600)):
        stamp = f"{datetime.fromtimestamp(started_s, UTC):%Y%m%d-%H%M%S}"
        folder = tmp_path / "card" / f"drive-000{number}-{stamp}"
        folder.mkdir(parents=True)
        shutil.copy(RECORDED / "000.mcap", folder)
        os.utime(folder / "000.mcap", (started_s + 5, started_s + 5))
    command = ["recordings", "fill", str(torn), "--json", "--robot"]
    wrong = CliRunner().invoke(app, [*command, robot.address])
    assert "is of robot virtual, and this one is mbot-1" in str(wrong.exception)
    with FakeRobot("virtual") as right:
        right.replies.update(RecordingService("virtual", directory, enabled=True).answers)
        result = CliRunner().invoke(app, [*command, right.address])
    assert result.exit_code == 0, result.output
    found = json.loads(result.output)
    assert (found["filled_beats"], found["still_missing"]) == (4, 0)
    here = tmp_path / FillOptions(recording=torn).into / "virtual"
    assert [path.name[:10] for path in here.iterdir()] == ["drive-0001"]
