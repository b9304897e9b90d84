import errno
import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from mcap.reader import make_reader

from mbot_protocol.beat.beat import Beat, PolicyInput
from mbot_protocol.beat.channels import ROBOT_METADATA, RobotFacts
from mbot_protocol.beat.fields import drive_numbers
from mbot_protocol.beat.recorded_drive import read_drive
from mbot_protocol.beat.whole_chunks import WholeChunks
from mbot_protocol.beat.writer import SYNC_AFTER_S, BeatWriter
from mbot_protocol.drive.actions import MotorMap, WheelMaps

from ..workstation.samples import decision, picture

FACTS = RobotFacts(
    robot_id="mbot-1",
    session_id=2**63 + 5,
    software_version="0.1.0",
    processor="aarch64",
    decision_rate_hz=2.5,
    wheels=WheelMaps(MotorMap(trim=0.9, dead_band=41), MotorMap(dead_band=0)),
)


def beat(number: int) -> Beat:
    told = PolicyInput(True, False, 0.5, -0.25, b"\x00\x00\x80\x3f", 55.3, 42.9)
    return Beat(decision(number), told, encoded=picture().data, is_exact=True)


def writer(path: Path) -> BeatWriter:
    return BeatWriter(path, "mbot-1", "a test", FACTS)


def test_a_file_is_what_any_library_reads(tmp_path: Path) -> None:
    path = tmp_path / "000.mcap"
    file = writer(path)
    file.write(beat(0))
    file.close()
    with path.open("rb") as opened:
        reader = make_reader(opened, validate_crcs=True)
        found = list(reader.iter_messages())
        (robot,) = reader.iter_metadata()
    topics = {channel.topic: schema for schema, channel, _ in found}
    assert {message.log_time for _, _, message in found} == {decision(0).unix_time_ns}
    (numbers,) = (message.data for _, channel, message in found if channel.topic.endswith("/drive"))
    assert json.loads(numbers) == drive_numbers(decision(0), beat(0).policy_input)
    kinds = {topic: (schema.name, schema.encoding) for topic, schema in topics.items() if schema}
    assert kinds == {
        "/mbot/mbot-1/decision": ("mbot.v1.Decision", "protobuf"),
        "/mbot/mbot-1/drive": ("mbot.DriveRecord", "jsonschema"),
        "/mbot/mbot-1/observation": ("foxglove.CompressedImage", "protobuf"),
        "/mbot/mbot-1/log": ("foxglove.Log", "protobuf"),
    }
    assert robot.name == ROBOT_METADATA
    assert RobotFacts.from_strings(robot.metadata) == FACTS


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    file = writer(tmp_path / "000.mcap")
    beats = [beat(0), replace(beat(1), encoded=b"", is_exact=False), Beat(decision(2))]
    for one in beats:
        file.write(one)
    file.close()
    drive = read_drive(tmp_path / "000.mcap")
    assert list(drive.beats) == beats
    assert (drive.facts, drive.words) == (FACTS, ())


def test_a_file_is_written_where_there_are_no_compressors(tmp_path: Path) -> None:
    code = """
import sys
from pathlib import Path
sys.modules |= {"lz4": None, "zstandard": None, "PIL": None}
from mbot_protocol.beat.beat import Beat
from mbot_protocol.beat.writer import BeatWriter
from mbot_protocol.v1.messages_pb2 import Decision
file = BeatWriter(Path(sys.argv[1]), "mbot-1", "a test")
file.write(Beat(Decision(sequence=7)))
file.close()
"""
    path = tmp_path / "000.mcap"
    done = subprocess.run([sys.executable, "-c", code, str(path)], check=False)
    assert done.returncode == 0
    with path.open("rb") as file:
        topics = [channel.topic for _, channel, _ in make_reader(file).iter_messages()]
    assert topics.count("/mbot/mbot-1/decision") == 1


def test_what_is_synced_can_be_read_while_the_file_is_open(tmp_path: Path) -> None:
    file = writer(tmp_path / "000.mcap")
    for number in range(3):
        file.write(beat(number))
        file.sync()
        assert len(read_drive(tmp_path / "000.mcap").beats) == number + 1
    file.abandon()


def test_it_says_when_a_sync_is_due(tmp_path: Path) -> None:
    now_s = [5.0]
    file = BeatWriter(tmp_path / "000.mcap", "mbot-1", "a test", monotonic_s=lambda: now_s[0])
    assert file.due_in_s is None
    file.write(beat(0))
    now_s[0] += 0.3
    file.write(beat(1))
    assert file.due_in_s == pytest.approx(SYNC_AFTER_S - 0.3)
    now_s[0] += 1.0
    assert file.due_in_s == 0.0
    file.sync()
    assert file.due_in_s is None
    file.close()


def test_a_damaged_first_chunk_costs_no_other(tmp_path: Path) -> None:
    path = tmp_path / "000.mcap"
    file = writer(path)
    sizes: list[int] = []
    for number in range(3):
        file.write(beat(number))
        file.sync()
        sizes.append(path.stat().st_size)
    file.abandon()
    data = bytearray(path.read_bytes())
    data[sizes[0] - 800] ^= 1
    path.write_bytes(data)
    chunks = WholeChunks(path)
    assert {message.log_time_ns for message in chunks.messages()} == {
        decision(number).unix_time_ns for number in (1, 2)
    }
    assert chunks.words == "2 of 3 chunks read, it was never ended properly"


def test_another_file_of_a_drive_goes_on_with_what_was_said(tmp_path: Path) -> None:
    stopped = decision(1)
    stopped.stop_count = 1
    file = BeatWriter(tmp_path / "001.mcap", "mbot-1", "a test", before=decision(0))
    file.write(Beat(stopped))
    file.close()
    assert [words for _, words in read_drive(tmp_path / "001.mcap").log] == ["stopped"]


def test_a_file_that_cannot_be_begun_is_not_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left"):
        writer(tmp_path / "000.mcap")
    assert list(tmp_path.iterdir()) == []
