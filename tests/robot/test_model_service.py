import math
import subprocess
import sys
import time
from pathlib import Path

import pytest

from mbot_agent import intake
from mbot_agent.models import model_service
from mbot_protocol.policy.dry_run import Report, dry_run
from mbot_protocol.v1.messages_pb2 import Activate, ModelList, PushReply
from mbot_protocol.wire.schema import SCHEMA_VERSION

from ..promised import promised
from .model_bench import OTHER_KEY, ROBOT_ID, Robot, digest, sign
from .tiny_models import constant_model

FIRST = constant_model(0.1, 0.1, name="first")
SECOND = constant_model(0.2, 0.2, name="second")
THIRD = constant_model(0.3, 0.3, name="third")


@pytest.fixture
def robot(tmp_path: Path) -> Robot:
    return Robot(tmp_path)


def test_a_push_becomes_active_and_survives_a_restart(robot: Robot, tmp_path: Path) -> None:
    reply = robot.push(FIRST)
    assert reply.accepted, reply.reason
    assert reply.active_model.name == "first"
    assert [policy.metadata.name for policy, _ in robot.used] == ["first"]
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
        digest(FIRST)[:6]: (True, False),
        digest(SECOND)[:6]: (False, True),
    }
    assert robot.activate(digest(SECOND)[:8]).accepted
    assert robot.active == "second"


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"no model at all", "not an ONNX model"),
        (constant_model(math.nan, 0.0), "two finite numbers"),
        (constant_model(input_shape=(1, 32, 32, 3)), "expected 'observation'"),
        (FIRST[:200], "truncated or damaged"),
    ],
)
def test_a_bad_model_leaves_the_old_one(tmp_path: Path, data: bytes, words: str) -> None:
    robot = Robot(tmp_path, try_model=dry_run)
    robot.push(SECOND)
    reply = robot.push(data)
    assert not reply.accepted
    assert words in reply.reason
    assert robot.active == "second"
    assert len(robot.used) == 1


def test_bytes_that_changed_on_the_way_are_refused_before_anything_reads_them(
    tmp_path: Path,
) -> None:
    tried: list[bytes] = []

    def try_model(data: bytes, _rate_hz: float) -> Report:
        tried.append(data)
        return Report(0.1, 0)

    robot = Robot(tmp_path, try_model=try_model)
    begun = robot.begin(FIRST)
    robot.chunk(begun.push_id, 0, FIRST[:-1] + b"?")
    reply = robot.commit(begun.push_id)
    assert not reply.accepted
    assert "digest" in reply.reason
    assert tried == []


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
    reply = robot.begin(FIRST, None, **changes)
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


def test_a_rollback_in_mid_push_is_not_undone_by_it(robot: Robot) -> None:
    robot.push(FIRST)
    robot.push(SECOND)
    begun = robot.begin(THIRD)
    robot.chunk(begun.push_id, 0, THIRD)
    robot.fail()
    assert robot.active == "first"
    reply = robot.commit(begun.push_id)
    assert "has become active meanwhile" in reply.reason
    assert robot.active == "first"


def test_a_rollback_during_the_dry_run_is_not_undone_either(tmp_path: Path) -> None:
    def go_back(_data: bytes, _rate_hz: float) -> Report:
        if len(robot.used) == 2:
            robot.fail()
        return Report(0.1, 0)

    robot = Robot(tmp_path, try_model=go_back)
    robot.push(FIRST)
    robot.push(SECOND)
    assert "has become active meanwhile" in robot.push(THIRD).reason
    assert robot.active == "first"


def test_a_push_that_trickles_is_forgotten_after_a_minute(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock_s = began_s = taken_s = time.monotonic()
    monkeypatch.setattr(time, "monotonic", lambda: clock_s)
    begun = robot.begin(FIRST)
    sent = 0
    while robot.chunk(begun.push_id, sent, FIRST[sent : sent + 1]).accepted:
        sent, taken_s = sent + 1, clock_s
        clock_s += 1.0  # never silent for long
        robot.service.expire_staging()
    assert 59 <= taken_s - began_s <= promised("trickle-dropped")
    assert robot.push(SECOND).accepted


def test_a_model_for_another_rate_is_accepted_with_a_word(robot: Robot) -> None:
    reply = robot.push(constant_model(decision_rate_hz=10.0))
    assert reply.accepted
    assert "made for 10 decisions/s, this robot makes 2.5" in reply.reason


def test_a_full_disk_is_a_reason(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    robot.push(SECOND)

    def full(_: object) -> object:
        return type("Usage", (), {"free": 1000})()

    monkeypatch.setattr(model_service.shutil, "disk_usage", full)
    reply = robot.begin(FIRST)
    assert "it takes 4.2 MB in " in reply.reason
    assert "0.0 MB are free; shorten its log" in reply.reason
    assert "keep fewer than the 1 models" in reply.reason
    assert robot.active == "second"


def test_models_are_listed_with_their_standing(robot: Robot) -> None:
    robot.push(FIRST)
    robot.decide_well()
    robot.push(SECOND)
    robot.fail()
    found = {m.name: (m.active, m.proven, m.rejected, m.signed_by) for m in robot.list().models}
    assert found == {
        "first": (True, True, False, "anna"),
        "second": (False, False, True, "anna"),
    }
    status = robot.service.active_model
    assert status is not None
    assert (status.proven, status.signed_by, status.size_bytes) == (True, "anna", len(FIRST))
    assert status.stored_unix_time_ns > 10**18


@pytest.mark.parametrize("payload", [b"", b"\xff" * 40, b"\x08\x09"])
def test_malformed_requests_get_a_reason(robot: Robot, payload: bytes) -> None:
    service = robot.service
    for answer in (service.nonce, service.begin, service.chunk, service.commit):
        reply = PushReply.FromString(answer(payload))
        assert not reply.accepted
        assert reply.reason
    assert not ModelList.FromString(service.activate(payload)).accepted


MEMORY_CHECK = """
import sys, time
from pathlib import Path
from mbot_protocol.wire.keys import CHUNK_BYTES
from tests.robot.model_bench import Robot

def resident_mb():
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 2**20

robot = Robot(Path(sys.argv[1]))
before = resident_mb()
data = bytes(range(256)) * (16 * 2**12)
push_id = robot.begin(data).push_id
for offset in range(0, len(data) - CHUNK_BYTES, CHUNK_BYTES):
    assert robot.chunk(push_id, offset, data[offset : offset + CHUNK_BYTES]).accepted
del data
staged = resident_mb()
now = time.monotonic
time.monotonic = lambda: now() + float(sys.argv[2])
robot.service.expire_staging()
assert not robot.commit(push_id).accepted
print(staged - before, resident_mb() - before)
"""


def test_the_memory_of_a_push_whose_sender_died_comes_back(tmp_path: Path) -> None:
    after_s = intake.EXPIRES_S + 1
    assert after_s <= promised("push-memory-back")
    done = subprocess.run(
        [sys.executable, "-c", MEMORY_CHECK, str(tmp_path), str(after_s)],
        capture_output=True,
        text=True,
        check=True,
        cwd=Path(__file__).parents[2],
    )
    staged_mb, kept_mb = (float(word) for word in done.stdout.split())
    assert staged_mb >= 15
    assert kept_mb <= 4


def test_going_back_takes_a_word_signed_for_that_model_and_this_time(robot: Robot) -> None:
    for data in (FIRST, SECOND):
        assert robot.push(data).accepted
    assert "not signed" in robot.activate(key=None).reason
    assert not robot.activate(key=OTHER_KEY).accepted
    other = Activate(schema_version=SCHEMA_VERSION, robot_id=ROBOT_ID, sha256=digest(FIRST))
    signed = sign(SECOND, robot.nonce())
    other.manifest, other.signature = signed.manifest, signed.signature
    other.public_key = signed.public_key
    reply = ModelList.FromString(robot.service.activate(other.SerializeToString()))
    assert "another model's" in reply.reason
    signed = sign(FIRST, robot.nonce())
    other.manifest, other.signature = signed.manifest, signed.signature
    assert ModelList.FromString(robot.service.activate(other.SerializeToString())).accepted
    assert robot.active == "first"
    assert robot.push(THIRD).accepted
    again = ModelList.FromString(robot.service.activate(other.SerializeToString()))
    assert "nonce" in again.reason
