import os
import subprocess
import sys
from pathlib import Path

import pytest

from mbot_protocol.beat.recorded_drive import read_drive
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.fleet.telemetry.telemetry_file import SAVE_AFTER_S, TelemetryFile

from .samples import decision, picture


def record(path: Path, count: int) -> None:
    with TelemetryFile(path, "mbot-1") as recording:
        for sequence in range(count):
            recording.write(picture(decision(sequence).unix_time_ns))
            recording.write(decision(sequence))


def test_a_recording_reads_back_in_order(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    record(path, 3)
    beats = read_drive(path).beats
    assert [beat.decision for beat in beats] == [decision(i) for i in range(3)]
    assert [beat.encoded for beat in beats] == [picture().data] * 3
    assert not any(beat.is_replayable for beat in beats), "only the robot knows what that takes"


def test_a_process_that_dies_loses_at_most_a_second(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    script = f"""
import os, pathlib
from mbot_protocol.beat.changes import changes
from mbot_workstation.fleet.telemetry.telemetry_file import TelemetryFile
from mbot_protocol.v1.messages_pb2 import Decision
clock_s = 0.0
recording = TelemetryFile(pathlib.Path({str(path)!r}), "mbot-1", lambda: clock_s)
for sequence in range(100):
    clock_s += 0.1
    recording.write(Decision(schema_version=1, sequence=sequence, unix_time_ns=1 + sequence))
os._exit(9)
"""
    subprocess.run([sys.executable, "-c", script], check=False)
    sequences = [beat.decision.sequence for beat in read_drive(path).beats]
    assert sequences == list(range(len(sequences)))
    assert len(sequences) >= 100 - 10 * SAVE_AFTER_S - 1


def test_what_came_before_a_pause_is_saved_during_it(tmp_path: Path) -> None:
    clock_s = [0.0]
    with TelemetryFile(tmp_path / "drive.mcap", "mbot-1", lambda: clock_s[0]) as recording:
        recording.write(decision())
        clock_s[0] = SAVE_AFTER_S + 0.01
        recording.save_if_due()
        assert len(read_drive(tmp_path / "drive.mcap").beats) == 1


def test_every_cut_gives_back_a_beginning(tmp_path: Path) -> None:
    path, clock_s = tmp_path / "drive.mcap", [0.0]
    with TelemetryFile(path, "mbot-1", lambda: clock_s[0]) as recording:
        for sequence in range(20):
            clock_s[0] += 0.2
            recording.write(decision(sequence))
    data, cut = path.read_bytes(), tmp_path / "cut.mcap"
    counts: list[int] = []
    first_chunk = data.index(b"\x06", 100)
    for size in range(first_chunk, len(data), 97):
        cut.write_bytes(data[:size])
        try:
            drive = read_drive(cut)
        except ConfigurationError:
            counts.append(0)
            continue
        found = [beat.decision for beat in drive.beats]
        assert found == [decision(sequence) for sequence in range(len(found))]
        assert drive.words
        counts.append(len(found))
    assert counts == sorted(counts)
    assert counts[-1] == 20


def test_damage_in_the_middle_costs_what_it_hit(tmp_path: Path) -> None:
    path, clock_s = tmp_path / "drive.mcap", [0.0]
    with TelemetryFile(path, "mbot-1", lambda: clock_s[0]) as recording:
        for sequence in range(20):
            clock_s[0] += 0.2
            recording.write(decision(sequence))
    data = bytearray(path.read_bytes())
    for offset in range(len(data) // 2, len(data) // 2 + 40):
        data[offset] ^= 0xFF
    path.write_bytes(data)
    drive = read_drive(path)
    assert 0 < len(drive.beats) < 20
    assert drive.words


def test_no_recording_is_told(tmp_path: Path) -> None:
    path = tmp_path / "notes.mcap"
    path.write_text("no")
    with pytest.raises(ConfigurationError, match="not an MCAP recording"):
        read_drive(path)
    with pytest.raises(ConfigurationError, match="No such file"):
        read_drive(tmp_path / "none.mcap")


def test_a_recording_is_never_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    record(path, 1)
    with pytest.raises(ConfigurationError, match="exists already"):
        TelemetryFile(path, "mbot-1")
    with pytest.raises(ConfigurationError, match="No such file"):
        TelemetryFile(tmp_path / "no" / "drive.mcap", "mbot-1")


def test_a_full_disk_is_one_line(tmp_path: Path) -> None:
    def write_to_a_full_disk() -> None:
        with TelemetryFile(tmp_path / "drive.mcap", "mbot-1") as recording:
            full = os.open("/dev/full", os.O_WRONLY)
            os.dup2(full, recording._writer._file.fileno())  # pyright: ignore[reportPrivateUsage]
            os.close(full)
            recording.write(decision())

    with pytest.raises(ConfigurationError, match="No space left"):
        write_to_a_full_disk()
