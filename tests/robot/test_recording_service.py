import hashlib
from pathlib import Path

import pytest

from mbot_agent.recording.recording_service import MOST_LISTED, RecordingService
from mbot_protocol.v1 import recordings_pb2 as recordings
from mbot_protocol.wire import keys
from mbot_protocol.wire.schema import SCHEMA_VERSION

from .recording_bench import directory

DATA = bytes(range(256)) * 1000


@pytest.fixture
def service(tmp_path: Path) -> RecordingService:
    found = directory(tmp_path)
    (found.new_drive() / "000.mcap").write_bytes(DATA)
    return RecordingService("mbot-1", found, enabled=True)


def drives(service: RecordingService) -> recordings.RecordingList:
    return recordings.RecordingList.FromString(service.drives(b""))


def name(service: RecordingService) -> str:
    return drives(service).drives[0].name


def part(service: RecordingService, **changes: object) -> recordings.RecordingPart:
    fields: dict[str, object] = {
        "schema_version": SCHEMA_VERSION,
        "robot_id": "mbot-1",
        "drive": name(service),
        "file": "000.mcap",
        "offset_bytes": 0,
        "count_bytes": keys.CHUNK_BYTES,
    }
    request = recordings.RecordingRead(**(fields | changes))  # pyright: ignore[reportArgumentType]
    return recordings.RecordingPart.FromString(service.read(request.SerializeToString()))


def test_every_key_is_answered(service: RecordingService) -> None:
    topics = {topic.name for topic in keys.TOPICS if topic.name.startswith("recordings/")}
    assert set(service.answers) == topics


def test_a_drive_is_listed_read_and_digested(service: RecordingService) -> None:
    (drive,) = drives(service).drives
    assert [(file.name, file.size_bytes) for file in drive.files] == [("000.mcap", len(DATA))]
    assert drives(service).free_bytes > 0
    assert drives(service).enabled
    assert part(service, offset_bytes=1000, count_bytes=500).data == DATA[1000:1500]
    request = recordings.RecordingDigest(
        schema_version=SCHEMA_VERSION,
        robot_id="mbot-1",
        drive=drive.name,
        file="000.mcap",
        size_bytes=len(DATA),
    )
    reply = recordings.RecordingDigestReply.FromString(service.digest(request.SerializeToString()))
    assert reply.sha256 == hashlib.sha256(DATA).hexdigest()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"count_bytes": 0}, "count_bytes is 0, expected 1 to 65536"),
        ({"count_bytes": 65537}, "expected 1 to 65536"),
        ({"robot_id": "mbot-2"}, "this is robot 'mbot-1', not 'mbot-2'"),
        ({"drive": "drive-0009-20200101-000000"}, "no recording"),
        ({"file": "../../x"}, "expected a name"),
        ({"offset_bytes": 2**63}, "far beyond"),
    ],
)
def test_what_makes_no_sense_is_refused_with_a_reason(
    service: RecordingService, changes: dict[str, object], words: str
) -> None:
    reply = part(service, **changes)
    assert not reply.accepted
    assert words in reply.reason


def test_keeping_and_removing_answer_with_what_there_is(service: RecordingService) -> None:
    fields: dict[str, object] = {
        "schema_version": SCHEMA_VERSION,
        "robot_id": "mbot-1",
        "drive": name(service),
    }
    keep = recordings.RecordingKeep(kept=True, **fields)  # pyright: ignore[reportArgumentType]
    kept = recordings.RecordingList.FromString(service.keep(keep.SerializeToString()))
    assert kept.accepted
    assert kept.drives[0].kept
    remove = recordings.RecordingRemove(**fields).SerializeToString()  # pyright: ignore[reportArgumentType]
    refused = recordings.RecordingList.FromString(service.remove(remove))
    assert not refused.accepted
    assert "is kept" in refused.reason
    keep.kept = False
    service.keep(keep.SerializeToString())
    assert recordings.RecordingList.FromString(service.remove(remove)).accepted
    assert not drives(service).drives


def test_a_list_has_an_end(tmp_path: Path) -> None:
    found = directory(tmp_path)
    for number in range(MOST_LISTED + 3):
        (tmp_path / f"drive-{number + 1:04d}-20260101-000000").mkdir()
    listed = drives(RecordingService("mbot-1", found, enabled=False))
    assert len(listed.drives) == MOST_LISTED
    assert listed.drives[0].name.startswith(f"drive-{MOST_LISTED + 3:04d}")
    assert not listed.enabled
