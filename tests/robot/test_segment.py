import subprocess
import sys
from pathlib import Path

import numpy as np
from foxglove_schemas_protobuf.Log_pb2 import Log
from mcap.reader import make_reader

from mbot_agent.recording.beat_log import BeatLog
from mbot_agent.recording.segment import Segment
from mbot_protocol.beat.drive_record import ROBOT_METADATA, RobotFacts
from mbot_protocol.drive.mcore import STOP
from mbot_protocol.policy.engine import processor_name
from mbot_workstation.fleet.recorded.whole_chunks import WholeChunks

from .recording_bench import FACTS, Drive, to_message, written


def test_a_file_is_what_any_library_reads(tmp_path: Path) -> None:
    path = tmp_path / "000.mcap"
    segment = Segment(path, FACTS)
    segment.write_decision(to_message(Drive().tick()), b"{}")
    segment.write_picture(np.zeros((64, 64, 3), np.uint8), 7)
    segment.write_log(Log.INFO, "now running", 7)
    segment.close()
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        topics = {channel.topic: schema for schema, channel, _ in reader.iter_messages()}
        (robot,) = reader.iter_metadata()
    kinds = {topic: (schema.name, schema.encoding) for topic, schema in topics.items() if schema}
    assert kinds == {
        "/mbot/mbot-1/decision": ("mbot.v1.Decision", "protobuf"),
        "/mbot/mbot-1/drive": ("mbot.DriveRecord", "jsonschema"),
        "/mbot/mbot-1/observation": ("foxglove.CompressedImage", "protobuf"),
        "/mbot/mbot-1/log": ("foxglove.Log", "protobuf"),
    }
    assert robot.name == ROBOT_METADATA
    assert RobotFacts.from_strings(robot.metadata) == FACTS


def test_a_file_is_written_where_there_are_no_compressors(tmp_path: Path) -> None:
    code = """
import sys
from pathlib import Path
sys.modules |= {"lz4": None, "zstandard": None}
from mbot_agent.recording.segment import Segment
from mbot_protocol.beat.drive_record import RobotFacts
facts = RobotFacts("mbot-1", 1, "0", "arm64", 2.5, False, 1.0, 0, False, 1.0, 0)
segment = Segment(Path(sys.argv[1]), facts)
segment.write_log(1, "now running", 7)
segment.close()
"""
    path = tmp_path / "000.mcap"
    done = subprocess.run([sys.executable, "-c", code, str(path)], check=False)
    assert done.returncode == 0
    with path.open("rb") as file:
        assert len(list(make_reader(file).iter_messages())) == 1


def test_what_is_synced_can_be_read_while_the_file_is_open(tmp_path: Path) -> None:
    path = tmp_path / "000.mcap"
    segment = Segment(path, FACTS)
    for index in range(3):
        segment.write_picture(np.full((64, 64, 3), index, np.uint8), index)
        segment.sync()
        assert len(written(path)["observation"]) == index + 1
    segment.abandon()


def test_a_damaged_first_chunk_costs_no_other(tmp_path: Path) -> None:
    path = tmp_path / "000.mcap"
    segment = Segment(path, FACTS)
    sizes: list[int] = []
    for index in range(3):
        segment.write_picture(np.full((64, 64, 3), index, np.uint8), index)
        segment.sync()
        sizes.append(path.stat().st_size)
    segment.abandon()
    data = bytearray(path.read_bytes())
    data[sizes[0] - 400] ^= 1
    path.write_bytes(data)
    chunks = WholeChunks(path)
    assert len(list(chunks.messages())) == 2
    assert chunks.words == "2 of 3 chunks read, it was never ended properly"


def test_only_what_changes_is_told() -> None:
    drive, log = Drive(), BeatLog()
    first = [words for _, words in log.changes(drive.tick())]
    assert first[1:] == ["now idle"]
    assert list(log.changes(drive.tick())) == []
    drive.bench.run()
    assert [words for _, words in log.changes(drive.tick())] == ["now running"]
    drive.bench.hold(STOP, 0)
    assert [words for _, words in log.changes(drive.tick())] == ["now stopped: the hand has let go"]


def test_the_processor_is_named(tmp_path: Path) -> None:
    cpuinfo = tmp_path / "cpuinfo"
    cpuinfo.write_text("processor\t: 0\nmodel name\t: Fast One\n\nprocessor\t: 1\n")
    assert processor_name(cpuinfo).endswith(" Fast One")
    assert processor_name(tmp_path / "none")
