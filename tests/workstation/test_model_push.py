from collections.abc import Iterator
from pathlib import Path

import pytest

from mbot_protocol.errors import ContractError, RefusedError
from mbot_protocol.keys import ACTIVATE, CHUNK_BYTES, PUSH_BEGIN, PUSH_CHUNK, PUSH_COMMIT
from mbot_protocol.schema import MalformedMessageError
from mbot_protocol.v1.messages_pb2 import Activate, ModelList, PushReply
from mbot_workstation.model_push import push
from mbot_workstation.model_store import activate, list_models, model_fields
from mbot_workstation.robot_link import RobotLink

from .fake_robot import OLD_MODEL, FakeRobot
from .samples import small_policy


@pytest.fixture
def link(robot: FakeRobot) -> Iterator[RobotLink]:
    with RobotLink(robot.address) as link:
        yield link


@pytest.fixture
def policy(tmp_path: Path) -> Path:
    path = tmp_path / "policy.onnx"
    path.write_bytes(small_policy(weights_bytes=2 * CHUNK_BYTES).SerializeToString())
    return path


def refusal(reason: str) -> PushReply:
    return PushReply(schema_version=1, accepted=False, reason=reason)


def test_a_model_arrives_whole_in_acknowledged_chunks(
    robot: FakeRobot, link: RobotLink, policy: Path
) -> None:
    progress: list[tuple[int, int]] = []
    pushed = push(link, policy, lambda sent, total: progress.append((sent, total)))
    size_bytes = policy.stat().st_size
    assert bytes(robot.staged) == policy.read_bytes()
    assert (pushed.model.name, pushed.advice) == ("new", "made for 5 decisions/s")
    assert robot.wanted.expected_active_sha256 == OLD_MODEL.sha256
    assert robot.wanted.size_bytes == size_bytes
    assert [sent for sent, _ in progress] == [CHUNK_BYTES, 2 * CHUNK_BYTES, size_bytes]
    assert robot.names() == ["status", PUSH_BEGIN.name, *[PUSH_CHUNK.name] * 3, PUSH_COMMIT.name]


def test_a_model_that_is_active_already_is_not_sent_again(
    robot: FakeRobot, link: RobotLink, policy: Path
) -> None:
    push(link, policy)
    robot.received.clear()
    assert push(link, policy).model.name == "new"
    assert robot.names() == ["status"]


@pytest.mark.parametrize("step", [PUSH_BEGIN, PUSH_CHUNK, PUSH_COMMIT])
def test_a_refusal_at_any_step_gives_the_reason(
    robot: FakeRobot, link: RobotLink, policy: Path, step
) -> None:
    robot.replies[step.name] = lambda _data: refusal("the disk is full")
    with pytest.raises(RefusedError, match="keeps its own: the disk is full"):
        push(link, policy)
    assert robot.active == OLD_MODEL


def test_a_lost_chunk_is_noticed(robot: FakeRobot, link: RobotLink, policy: Path) -> None:
    robot.replies[PUSH_CHUNK.name] = lambda _data: PushReply(schema_version=1, accepted=True)
    with pytest.raises(MalformedMessageError, match="0 bytes of the model, expected 65536"):
        push(link, policy)


def test_a_robot_that_activates_another_model_is_noticed(
    robot: FakeRobot, link: RobotLink, policy: Path
) -> None:
    robot.replies[PUSH_COMMIT.name] = lambda _data: PushReply(
        schema_version=1, accepted=True, active_model=OLD_MODEL
    )
    with pytest.raises(MalformedMessageError, match="another one as active"):
        push(link, policy)


def test_a_bad_file_never_leaves(robot: FakeRobot, link: RobotLink, tmp_path: Path) -> None:
    path = tmp_path / "notes.txt"
    path.write_text("not a model")
    with pytest.raises(ContractError):
        push(link, path)
    assert robot.received == []


def test_an_interrupted_push_is_never_committed(
    robot: FakeRobot, link: RobotLink, policy: Path
) -> None:
    def interrupt(_sent: int, _total: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        push(link, policy, interrupt)
    assert PUSH_COMMIT.name not in robot.names()
    assert robot.active == OLD_MODEL


def test_models_are_listed(link: RobotLink) -> None:
    active, previous = list_models(link)
    assert model_fields(active)["sha256"] == "a" * 64
    assert (active.active, previous.previous) == (True, True)


def test_a_model_is_activated_by_its_digest(robot: FakeRobot, link: RobotLink) -> None:
    activate(link, "b" * 8)
    request = Activate.FromString(robot.received[-1][1])
    assert (request.robot_id, request.sha256) == ("mbot-1", "b" * 8)


def test_an_unknown_model_is_refused(robot: FakeRobot, link: RobotLink) -> None:
    robot.replies[ACTIVATE.name] = lambda _data: ModelList(schema_version=1, reason="none such")
    with pytest.raises(RefusedError, match="mbot-1 refused: none such"):
        activate(link)
