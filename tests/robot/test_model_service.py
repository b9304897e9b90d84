import hashlib
import math
import time
from pathlib import Path

import pytest

from mbot_agent import model_service
from mbot_agent.configuration import Configuration, Models
from mbot_agent.model_service import ModelService
from mbot_agent.model_store import ModelStore
from mbot_agent.policy import Policy
from mbot_protocol.keys import CHUNK_BYTES
from mbot_protocol.schema import SCHEMA_VERSION
from mbot_protocol.v1.messages_pb2 import (
    Activate,
    ModelList,
    PushBegin,
    PushChunk,
    PushCommit,
    PushReply,
)

from .tiny_models import constant_model

FIRST = constant_model(0.1, 0.1, name="first")
SECOND = constant_model(0.2, 0.2, name="second")


class Robot:
    """A model service and what it handed to the control loop."""

    def __init__(self, directory: Path) -> None:
        self.used: list[Policy] = []
        configuration = Configuration(robot_id="mbot-1", models=Models(str(directory), keep=4))
        store = ModelStore(directory, 4)
        self.service = ModelService(configuration, store, self.used.append)
        self.service.load_active()

    @property
    def active(self) -> str:
        model = self.service.active_model
        return model.name if model is not None else ""

    def begin(self, data: bytes, **changes: object) -> PushReply:
        model = self.service.active_model
        fields: dict[str, object] = {
            "schema_version": SCHEMA_VERSION,
            "robot_id": "mbot-1",
            "sha256": hashlib.sha256(data).hexdigest(),
            "size_bytes": len(data),
            "expected_active_sha256": model.sha256 if model is not None else "",
        }
        request = PushBegin(**(fields | changes))  # pyright: ignore[reportArgumentType]
        return PushReply.FromString(self.service.begin(request.SerializeToString()))

    def chunk(self, push_id: str, offset: int, data: bytes) -> PushReply:
        request = PushChunk(
            schema_version=SCHEMA_VERSION, push_id=push_id, offset_bytes=offset, data=data
        )
        return PushReply.FromString(self.service.chunk(request.SerializeToString()))

    def commit(self, push_id: str) -> PushReply:
        request = PushCommit(schema_version=SCHEMA_VERSION, push_id=push_id)
        return PushReply.FromString(self.service.commit(request.SerializeToString()))

    def push(self, data: bytes, **changes: object) -> PushReply:
        reply = self.begin(data, **changes)
        if not reply.accepted:
            return reply
        for offset in range(0, len(data), CHUNK_BYTES):
            piece = data[offset : offset + CHUNK_BYTES]
            acknowledged = self.chunk(reply.push_id, offset, piece)
            if not acknowledged.accepted:
                return acknowledged
        return self.commit(reply.push_id)

    def activate(self, sha256: str = "") -> ModelList:
        request = Activate(schema_version=SCHEMA_VERSION, robot_id="mbot-1", sha256=sha256)
        return ModelList.FromString(self.service.activate(request.SerializeToString()))


@pytest.fixture
def robot(tmp_path: Path) -> Robot:
    return Robot(tmp_path)


def test_a_push_becomes_active_and_survives_a_restart(robot: Robot, tmp_path: Path) -> None:
    reply = robot.push(FIRST)
    assert reply.accepted, reply.reason
    assert reply.active_model.name == "first"
    assert [policy.metadata.name for policy in robot.used] == ["first"]
    assert Robot(tmp_path).active == "first"


def test_rolling_back_returns_to_the_previous_model(robot: Robot) -> None:
    assert not robot.activate().accepted
    robot.push(FIRST)
    robot.push(SECOND)
    reply = robot.activate()
    assert reply.accepted, reply.reason
    assert robot.active == "first"
    assert {m.name for m in reply.models} == {"first", "second"}
    assert {m.sha256[:6]: (m.active, m.previous) for m in reply.models} == {
        hashlib.sha256(FIRST).hexdigest()[:6]: (True, False),
        hashlib.sha256(SECOND).hexdigest()[:6]: (False, True),
    }
    assert robot.activate(hashlib.sha256(SECOND).hexdigest()[:8]).accepted
    assert robot.active == "second"


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"no model at all", "onnxruntime cannot load"),
        (constant_model(math.nan, 0.0), "two finite numbers"),
        (constant_model(input_shape=(1, 32, 32, 3)), "expected 'observation'"),
        (FIRST[:200], "onnxruntime cannot load"),
    ],
)
def test_a_bad_model_leaves_the_old_one(robot: Robot, data: bytes, words: str) -> None:
    robot.push(SECOND)
    reply = robot.push(data)
    assert not reply.accepted
    assert words in reply.reason
    assert robot.active == "second"
    assert len(robot.used) == 1


def test_bytes_that_changed_on_the_way_are_refused(robot: Robot) -> None:
    begun = robot.begin(FIRST)
    robot.chunk(begun.push_id, 0, FIRST[:-1] + b"?")
    reply = robot.commit(begun.push_id)
    assert not reply.accepted
    assert "digest" in reply.reason


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"robot_id": "mbot-2"}, "for robot 'mbot-2'"),
        ({"sha256": "../../etc/passwd"}, "64 hexadecimal"),
        ({"size_bytes": 0}, "expected 1 to"),
        ({"size_bytes": 1 << 40}, "expected 1 to"),
        ({"expected_active_sha256": "0" * 64}, "has become active meanwhile"),
        ({"schema_version": 9}, "speaks schema 9"),
        ({"schema_version": 0}, "without a schema version"),
    ],
)
def test_a_push_that_should_not_begin_is_told_why(
    robot: Robot, changes: dict[str, object], words: str
) -> None:
    reply = robot.begin(FIRST, **changes)
    assert not reply.accepted
    assert words in reply.reason


def test_of_two_pushes_at_once_one_wins_and_the_other_learns_why(robot: Robot) -> None:
    first = robot.begin(FIRST)
    second = robot.begin(SECOND)
    assert not second.accepted
    assert "another push is under way" in second.reason
    robot.chunk(first.push_id, 0, FIRST)
    assert robot.commit(first.push_id).accepted
    late = robot.begin(SECOND, expected_active_sha256="")
    assert "has become active meanwhile" in late.reason
    assert robot.active == "first"


def test_a_push_whose_sender_died_is_forgotten(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun = robot.begin(FIRST)
    later_s = time.monotonic() + model_service.STAGING_EXPIRES_S + 1
    monkeypatch.setattr(time, "monotonic", lambda: later_s)
    robot.service.expire_staging()
    reply = robot.chunk(begun.push_id, 0, FIRST)
    assert "not under way" in reply.reason
    assert robot.push(SECOND).accepted


def test_chunks_out_of_order_or_size_are_refused(robot: Robot) -> None:
    begun = robot.begin(FIRST)
    assert "begins at byte 5" in robot.chunk(begun.push_id, 5, FIRST[:10]).reason
    assert "expected 1 to" in robot.chunk(begun.push_id, 0, FIRST + b"more").reason
    assert "expected 1 to" in robot.chunk(begun.push_id, 0, b"").reason
    assert "not under way" in robot.chunk("another", 0, FIRST).reason
    robot.chunk(begun.push_id, 0, FIRST[:10])
    assert "bytes have arrived" in robot.commit(begun.push_id).reason


def test_a_model_for_another_rate_is_accepted_with_a_word(robot: Robot) -> None:
    reply = robot.push(constant_model(decision_rate_hz=10.0))
    assert reply.accepted
    assert "made for 10 decisions/s, this robot makes 2.5" in reply.reason


def test_at_start_a_damaged_active_model_gives_way_to_the_previous_one(
    robot: Robot, tmp_path: Path
) -> None:
    robot.push(FIRST)
    robot.push(SECOND)
    (tmp_path / f"{hashlib.sha256(SECOND).hexdigest()}.onnx").write_bytes(SECOND[:-5])
    assert Robot(tmp_path).active == "first"


def test_a_full_disk_is_a_reason(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    robot.push(SECOND)

    def full(_: object) -> object:
        return type("Usage", (), {"free": 1000})()

    monkeypatch.setattr(model_service.shutil, "disk_usage", full)
    reply = robot.begin(FIRST)
    assert "only 1000 bytes are free" in reply.reason
    assert robot.active == "second"
