import runpy
from pathlib import Path

import pytest

from mbot_protocol.errors import NewerSchemaError
from mbot_protocol.v1.messages_pb2 import Status
from mbot_protocol.wire.schema import SCHEMA_VERSION, MalformedMessageError, decode

PROTOCOL = Path(__file__).parents[2] / "shared" / "protocol"


def test_the_generated_code_is_current(tmp_path: Path) -> None:
    runpy.run_path(str(PROTOCOL / "generate.py"))["generate"](tmp_path)
    for name in (f"{one}_pb2.py{end}" for one in ("messages", "recordings") for end in ("", "i")):
        generated = tmp_path / "mbot_protocol" / "v1" / name
        committed = PROTOCOL / "mbot_protocol" / "v1" / name
        assert generated.read_text() == committed.read_text(), "run `make protocol`"


def test_a_message_is_read_back() -> None:
    status = Status(schema_version=SCHEMA_VERSION, robot_id="mbot-1", now_monotonic_ns=5)
    assert decode(Status, status.SerializeToString(), "robot") == status


def test_a_newer_schema_says_who_must_upgrade() -> None:
    data = Status(schema_version=SCHEMA_VERSION + 1).SerializeToString()
    with pytest.raises(NewerSchemaError, match=r"robot mbot-1 speaks schema 2.*up to 1: upgrade"):
        decode(Status, data, "robot mbot-1")


def test_a_message_without_a_version_is_none_of_ours() -> None:
    with pytest.raises(MalformedMessageError, match="without a schema version"):
        decode(Status, b"", "robot")
