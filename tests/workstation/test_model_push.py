import time
from io import BytesIO
from pathlib import Path

import pytest

from mbot_protocol.errors import ContractError, RefusedError
from mbot_protocol.signing.envelope import MODEL, Envelope, Signature, verify
from mbot_protocol.signing.model_manifest import decode
from mbot_protocol.v1.messages_pb2 import (
    Activate,
    ModelList,
    PushBegin,
    PushNonceReply,
    PushReply,
    Status,
)
from mbot_protocol.wire.keys import (
    ACTIVATE,
    CHUNK_BYTES,
    PUSH_BEGIN,
    PUSH_CHUNK,
    PUSH_COMMIT,
    PUSH_NONCE,
)
from mbot_protocol.wire.schema import MalformedMessageError
from mbot_workstation.fleet.link.pieces import push_in_pieces
from mbot_workstation.fleet.link.robot_link import RobotLink
from mbot_workstation.fleet.models.check import check_model
from mbot_workstation.fleet.models.push import PUSH, push, push_checked
from mbot_workstation.fleet.models.signing_key import SigningKey
from mbot_workstation.fleet.models.stored_models import StoredModel, activate, list_models

from .fake_robot import NONCE, OLD_MODEL, ROBOT_ID, FakeRobot
from .samples import small_policy


@pytest.fixture
def policy(tmp_path: Path) -> Path:
    path = tmp_path / "policy.onnx"
    path.write_bytes(small_policy(weights_bytes=2 * CHUNK_BYTES).SerializeToString())
    return path


KEY = SigningKey.ephemeral("anna")


def unsigned(_status: Status) -> None:
    return None


def signed(_status: Status) -> SigningKey:
    return KEY


def test_a_model_arrives_whole_in_acknowledged_chunks(
    robot: FakeRobot, link: RobotLink, policy: Path
) -> None:
    progress: list[tuple[int, int]] = []
    pushed = push(link, policy, signed, lambda sent, total: progress.append((sent, total)))
    size_bytes = policy.stat().st_size
    assert bytes(robot.staged) == policy.read_bytes()
    assert (pushed.model.name, pushed.advice) == ("new", "made for 5 decisions/s")
    assert robot.wanted.expected_active_sha256 == OLD_MODEL.sha256
    assert robot.wanted.size_bytes == size_bytes
    assert [sent for sent, _ in progress] == [CHUNK_BYTES, 2 * CHUNK_BYTES, size_bytes]
    chunks = [PUSH_CHUNK.name] * 3
    expected = ["status", PUSH_NONCE.name, PUSH_BEGIN.name, *chunks, PUSH_COMMIT.name]
    assert robot.names() == expected


def test_what_is_signed_is_this_push_to_this_robot(
    robot: FakeRobot, link: RobotLink, policy: Path
) -> None:
    push(link, policy, signed)
    first = robot.wanted
    envelope = Envelope(first.manifest, (Signature(first.public_key, first.signature),))
    assert verify(MODEL, envelope, [KEY.public]) == KEY.public
    said = decode(first.manifest)
    assert (said.robot_id, said.nonce) == (ROBOT_ID, NONCE)
    assert (said.sha256, said.size_bytes) == (first.sha256, first.size_bytes)
    assert abs(said.not_after_unix_s - time.time() - 86_400) < 3600
    assert not said.allow_downgrade
    robot.active = OLD_MODEL
    push_checked(link, check_model(policy), signed, lambda _s, _a: None, allow_downgrade=True)
    later = decode(robot.wanted.manifest)
    assert later.allow_downgrade
    assert later.sequence > said.sequence


def test_without_a_key_nothing_is_signed(robot: FakeRobot, link: RobotLink, policy: Path) -> None:
    push(link, policy, unsigned)
    assert PUSH_NONCE.name not in robot.names()
    assert robot.wanted == PushBegin(
        schema_version=1,
        robot_id=ROBOT_ID,
        sha256=robot.wanted.sha256,
        size_bytes=policy.stat().st_size,
        expected_active_sha256=OLD_MODEL.sha256,
    )


@pytest.mark.parametrize("nonce", ["", "no nonce", '5a"}'])
def test_nothing_but_a_nonce_is_signed(
    robot: FakeRobot, link: RobotLink, policy: Path, nonce: str
) -> None:
    robot.replies[PUSH_NONCE.name] = lambda _data: PushNonceReply(
        schema_version=1, accepted=True, nonce=nonce
    )
    with pytest.raises(RefusedError, match="manifest is unusable"):
        push(link, policy, signed)
    assert PUSH_BEGIN.name not in robot.names()


def test_a_model_that_is_active_already_is_not_sent_again(
    robot: FakeRobot, link: RobotLink, policy: Path
) -> None:
    push(link, policy, signed)
    robot.received.clear()
    assert push(link, policy, signed).model.name == "new"
    assert robot.names() == ["status"]


@pytest.mark.parametrize("step", [PUSH_NONCE, PUSH_BEGIN, PUSH_CHUNK, PUSH_COMMIT])
def test_a_refusal_at_any_step_gives_the_reason(
    robot: FakeRobot, link: RobotLink, policy: Path, step
) -> None:
    kind = PushNonceReply if step is PUSH_NONCE else PushReply
    robot.replies[step.name] = lambda _data: kind(schema_version=1, reason="the disk is full")
    with pytest.raises(RefusedError, match="keeps its own: the disk is full"):
        push(link, policy, signed)
    assert robot.active == OLD_MODEL


def test_a_lost_chunk_is_noticed(robot: FakeRobot, link: RobotLink, policy: Path) -> None:
    robot.replies[PUSH_CHUNK.name] = lambda _data: PushReply(schema_version=1, accepted=True)
    with pytest.raises(MalformedMessageError, match="0 bytes of it, expected 65536"):
        push(link, policy, signed)
    begin, content = PushBegin(schema_version=1, robot_id=ROBOT_ID), BytesIO(b"ab")
    with pytest.raises(MalformedMessageError, match="0 bytes of it, expected 2"):
        push_in_pieces(link, PUSH, begin, content, 2, lambda _sent, _all: None)


def test_a_robot_that_activates_another_model_is_noticed(
    robot: FakeRobot, link: RobotLink, policy: Path
) -> None:
    robot.replies[PUSH_COMMIT.name] = lambda _data: PushReply(
        schema_version=1, accepted=True, active_model=OLD_MODEL
    )
    with pytest.raises(MalformedMessageError, match="another one as active"):
        push(link, policy, signed)


def test_a_bad_file_never_leaves(robot: FakeRobot, link: RobotLink, tmp_path: Path) -> None:
    path = tmp_path / "notes.txt"
    path.write_text("not a model")
    with pytest.raises(ContractError):
        push(link, path, signed)
    assert robot.received == []


def test_an_interrupted_push_is_never_committed(
    robot: FakeRobot, link: RobotLink, policy: Path
) -> None:
    def interrupt(_sent: int, _total: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        push(link, policy, signed, interrupt)
    assert PUSH_COMMIT.name not in robot.names()
    assert robot.active == OLD_MODEL


def test_models_are_listed(link: RobotLink) -> None:
    active, previous = list_models(link)
    assert StoredModel.of(active).sha256 == "a" * 64
    assert (active.active, previous.previous) == (True, True)


def test_a_model_is_activated_by_its_digest(robot: FakeRobot, link: RobotLink) -> None:
    activate(link, signed, "b" * 8)
    request = Activate.FromString(robot.received[-1][1])
    assert (request.robot_id, request.sha256) == ("mbot-1", "b" * 64)
    manifest = decode(request.manifest)
    assert (manifest.sha256, manifest.nonce, manifest.robot_id) == ("b" * 64, NONCE, "mbot-1")
    activate(link, lambda _status: None)
    request = Activate.FromString(robot.received[-1][1])
    assert (request.sha256, request.manifest) == ("", b"")


def test_an_unknown_model_is_refused(robot: FakeRobot, link: RobotLink) -> None:
    robot.replies[ACTIVATE.name] = lambda _data: ModelList(schema_version=1, reason="none such")
    with pytest.raises(RefusedError, match="mbot-1 refused: none such"):
        activate(link, signed)
