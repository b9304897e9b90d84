import errno
import json
import logging
import os
import subprocess
import sys
from pathlib import Path

import pytest
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from mcap.reader import make_reader

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.v1.messages_pb2 import Decision
from mbot_workstation.fleet.recorded.beat_changes import changes
from mbot_workstation.fleet.recorded.drive_mcap import FLUSH_EVERY_S, Recording, read_recording
from mbot_workstation.fleet.recorded.recorded_drive import read_drive

from .samples import decision, picture


def record(path: Path, count: int) -> None:
    with Recording(path, "mbot-1") as recording:
        for sequence in range(count):
            recording.write(picture(decision(sequence).unix_time_ns))
            recording.write(decision(sequence))


def test_a_recording_reads_back_in_order(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    record(path, 3)
    found = list(read_recording(path))
    assert [topic for topic, _ in found] == [
        "/mbot/mbot-1/observation",
        "/mbot/mbot-1/decision",
    ] * 3
    assert [message for _, message in found[1::2]] == [decision(i) for i in range(3)]
    assert isinstance(found[0][1], CompressedImage)


def test_the_file_has_an_index_schemas_and_the_robots_time(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    record(path, 2)
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
        assert summary is not None
        assert {schema.name for schema in summary.schemas.values()} == {
            "mbot.v1.Decision",
            "foxglove.CompressedImage",
            "foxglove.Log",
            "mbot.DriveRecord",
        }
        assert summary.statistics is not None
        assert summary.statistics.message_start_time == decision(0).unix_time_ns
        assert summary.statistics.message_end_time == decision(1).unix_time_ns


def test_a_viewer_plots_the_numbers_without_our_schema(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    record(path, 2)
    with path.open("rb") as file:
        told = [
            (channel.message_encoding, message.log_time, json.loads(message.data))
            for _, channel, message in make_reader(file).iter_messages(["/mbot/mbot-1/drive"])
        ]
    assert [encoding for encoding, _, _ in told] == ["json", "json"]
    assert [time_ns for _, time_ns, _ in told] == [decision(i).unix_time_ns for i in range(2)]
    numbers = told[1][2]
    assert (numbers["sequence"], numbers["action_left"], numbers["steps_right"]) == (1, 0.5, -62)
    assert numbers["frame_to_motors_ms"] == pytest.approx(60)
    assert "memory" not in numbers, "which telemetry does not tell"


def test_what_changes_is_said_in_words(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    record(path, 3)
    told = [line for _, line in read_drive(path).log]
    assert told == [words for _, words in changes(None, decision(0))]
    assert "now running" in told


def test_a_process_that_dies_loses_at_most_a_second(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    script = f"""
import os, pathlib
from mbot_workstation.fleet.recorded.beat_changes import changes
from mbot_workstation.fleet.recorded.drive_mcap import Recording
from mbot_protocol.v1.messages_pb2 import Decision
clock_s = 0.0
recording = Recording(pathlib.Path({str(path)!r}), "mbot-1", lambda: clock_s)
for sequence in range(100):
    clock_s += 0.1
    recording.write(Decision(schema_version=1, sequence=sequence, unix_time_ns=1 + sequence))
os._exit(9)
"""
    subprocess.run([sys.executable, "-c", script], check=False)
    sequences = [m.sequence for _, m in read_recording(path) if isinstance(m, Decision)]
    assert sequences == list(range(len(sequences)))
    assert len(sequences) >= 100 - 10 * FLUSH_EVERY_S - 1


def test_what_came_before_a_pause_is_saved_during_it(tmp_path: Path) -> None:
    clock_s = [0.0]
    with Recording(tmp_path / "drive.mcap", "mbot-1", lambda: clock_s[0]) as recording:
        recording.write(decision())
        clock_s[0] = FLUSH_EVERY_S + 0.01
        recording.save_if_due()
        assert len(list(read_recording(tmp_path / "drive.mcap"))) == 1


def test_every_cut_gives_back_a_beginning(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path, clock_s = tmp_path / "drive.mcap", [0.0]
    with Recording(path, "mbot-1", lambda: clock_s[0]) as recording:
        for sequence in range(20):
            clock_s[0] += 0.2
            recording.write(decision(sequence))
    data, cut = path.read_bytes(), tmp_path / "cut.mcap"
    counts: list[int] = []
    caplog.set_level(logging.WARNING)
    for size in range(8, len(data), 97):
        cut.write_bytes(data[:size])
        found = [message for _, message in read_recording(cut)]
        assert found == [decision(sequence) for sequence in range(len(found))]
        counts.append(len(found))
    assert counts == sorted(counts)
    assert counts[-1] == 20
    assert len(caplog.records) == len(counts)


def test_damage_in_the_middle_ends_the_reading(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    record(path, 20)
    data = bytearray(path.read_bytes())
    for offset in range(len(data) // 3, len(data) // 3 + 40):
        data[offset] ^= 0xFF
    path.write_bytes(data)
    assert len(list(read_recording(path))) < 40


def test_no_recording_is_told(tmp_path: Path) -> None:
    path = tmp_path / "notes.mcap"
    path.write_text("no")
    with pytest.raises(ConfigurationError, match="not an MCAP recording"):
        list(read_recording(path))
    with pytest.raises(ConfigurationError, match="No such file"):
        list(read_recording(tmp_path / "none.mcap"))


def test_a_recording_is_never_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    record(path, 1)
    with pytest.raises(ConfigurationError, match="exists already"):
        Recording(path, "mbot-1")
    with pytest.raises(ConfigurationError, match="No such file"):
        Recording(tmp_path / "no" / "drive.mcap", "mbot-1")


def test_a_full_disk_is_one_line(tmp_path: Path) -> None:
    def write_to_a_full_disk() -> None:
        with Recording(tmp_path / "drive.mcap", "mbot-1") as recording:
            full = os.open("/dev/full", os.O_WRONLY)
            os.dup2(full, recording._file.fileno())  # pyright: ignore[reportPrivateUsage]
            os.close(full)
            recording.write(decision())

    with pytest.raises(ConfigurationError, match="No space left"):
        write_to_a_full_disk()


def test_a_disk_that_is_full_from_the_start_leaves_no_empty_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(ConfigurationError, match=r"can't write .*drive\.mcap: No space left"):
        Recording(tmp_path / "drive.mcap", "mbot-1")
    assert list(tmp_path.iterdir()) == []
