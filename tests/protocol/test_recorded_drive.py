"""Recordings of before: what older versions have written is read as it was."""

from pathlib import Path

import pytest

from mbot_protocol.beat.recorded_drive import RecordedDrive, read_drive
from mbot_protocol.errors import ConfigurationError

DATA = Path(__file__).parents[1] / "data"


@pytest.fixture(scope="module")
def robots() -> RecordedDrive:
    """From a robot's card, before its recordings said what the pictures show."""
    return read_drive(DATA / "recorded-drive")


@pytest.fixture(scope="module")
def telemetrys() -> RecordedDrive:
    """By `telemetry --record`, before one writer wrote both kinds."""
    return read_drive(DATA / "recorded-telemetry" / "drive.mcap")


def test_a_robots_own_recording_can_still_be_replayed(robots: RecordedDrive) -> None:
    assert all(beat.is_replayable for beat in robots.beats)
    first, second = (robots.beats[number].policy_input for number in (0, 2))
    assert first is not None
    assert second is not None
    assert (first.began_anew, first.memory) == (True, b"")
    assert not second.began_anew
    assert len(second.memory) % 4 == 0
    assert len(second.memory) > 0
    assert robots.beats[0].view is None
    assert robots.facts is not None
    assert robots.facts.decision_rate_hz == 2.5


def test_telemetry_of_before_is_read_and_lacks_what_it_lacked(
    telemetrys: RecordedDrive, robots: RecordedDrive
) -> None:
    assert [beat.key for beat in telemetrys.beats] == [beat.key for beat in robots.beats[:5]]
    assert telemetrys.facts is None
    assert telemetrys.words == ()
    for beat in telemetrys.beats:
        assert beat.encoded.startswith(b"\xff\xd8")
        assert (beat.is_exact, beat.policy_input, beat.told) == (False, None, None)
        assert beat.decision.cpu_temperature_c == 51.5
        assert not beat.decision.HasField("under_voltage")
    assert [words for _, words in telemetrys.log][1:] == ["now running", "stop 2"]


def test_a_folder_is_read_in_the_order_of_its_files(tmp_path: Path) -> None:
    source = (DATA / "recorded-telemetry" / "drive.mcap").read_bytes()
    for name in ("1000.mcap", "999.mcap"):
        (tmp_path / name).write_bytes(source)
    assert [path.name for path in read_drive(tmp_path).paths] == ["999.mcap", "1000.mcap"]
    (tmp_path / "empty").mkdir()
    with pytest.raises(ConfigurationError):
        read_drive(tmp_path / "empty")
