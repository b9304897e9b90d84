"""Rows of the fault table: replay, downgrade, other robot's model, unsigned: 0 accepted."""

import sys
import time
from pathlib import Path

import pytest

from mbot_agent.configuration import Trust
from mbot_agent.models import trust
from mbot_agent.models.trust import LIFETIME_S, MOST_OUTSTANDING, Nonces
from mbot_protocol.errors import MbotError
from mbot_protocol.policy.policy_contract import INPUT_NAME, INPUT_TYPE
from mbot_protocol.signing.model_manifest import ModelManifest, Tensor
from mbot_protocol.v1.messages_pb2 import PushReply

from .model_bench import KEY, OTHER_KEY, Robot, SignedManifest, digest, sign
from .tiny_models import constant_model

OLD = constant_model(0.1, 0.1, name="old")
NEW = constant_model(0.2, 0.2, name="new")
UNSIGNED = SignedManifest(b"", b"", b"")
BOTH = Trust((KEY.public.line, OTHER_KEY.public.line))


@pytest.fixture
def robot(tmp_path: Path) -> Robot:
    robot = Robot(tmp_path)
    assert robot.push(OLD).accepted
    return robot


def assert_refused(robot: Robot, reply: PushReply, words: str) -> None:
    assert not reply.accepted
    assert words in reply.reason
    assert "\n" not in reply.reason
    assert robot.active == "old"
    assert Robot(robot.directory).active == "old"


def test_a_signed_model_is_taken_and_its_signer_remembered(robot: Robot) -> None:
    reply = robot.push(NEW)
    assert reply.accepted, reply.reason
    assert reply.active_model.signed_by == "anna"
    again = Robot(robot.directory).service.active_model
    assert again is not None
    assert (again.name, again.signed_by) == ("new", "anna")


def test_the_first_push_waits_for_no_library(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delitem(sys.modules, "nacl.signing", raising=False)
    Robot(tmp_path, trust=Trust())
    assert "nacl.signing" not in sys.modules, "without keys it would be for nothing"
    Robot(tmp_path)
    assert "nacl.signing" in sys.modules


def test_an_unsigned_model_is_refused(robot: Robot) -> None:
    assert_refused(robot, robot.push(NEW, UNSIGNED), "takes only models signed by anna")


def test_a_manifest_without_its_signature_is_refused(robot: Robot) -> None:
    assert_refused(robot, robot.push(NEW, signature=b""), "signature has 0 bytes")


def test_a_strangers_signature_is_refused(robot: Robot) -> None:
    signed = sign(NEW, robot.nonce(), OTHER_KEY)
    assert_refused(robot, robot.push(NEW, signed), "not among this robot's [trust] keys")
    pretended = robot.push(NEW, signed, public_key=KEY.public.raw)
    assert_refused(robot, pretended, "the signature is not anna's")


def test_a_changed_manifest_is_refused_and_never_read(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    signed = sign(NEW, robot.nonce())

    def read(_data: bytes) -> ModelManifest:
        raise AssertionError("a manifest was read before its signature was known to be good")

    monkeypatch.setattr(trust, "decode", read)
    changed = signed.manifest.replace(b'"allow_downgrade":false', b'"allow_downgrade":true ')
    reply = robot.begin(NEW, signed, manifest=changed)
    assert "the signature is not anna's" in reply.reason


def test_a_recorded_push_cannot_be_replayed(robot: Robot) -> None:
    signed = sign(NEW, robot.nonce())
    assert robot.push(NEW, signed).accepted
    assert robot.push(OLD).accepted
    assert_refused(robot, robot.push(NEW, signed), "nonce")


def test_nor_by_another_start_of_the_daemon(robot: Robot) -> None:
    signed = sign(NEW, robot.nonce())
    again = Robot(robot.directory)
    assert_refused(again, again.push(NEW, signed), "nonce")


def test_a_push_held_back_for_a_minute_is_refused(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    signed = sign(NEW, robot.nonce())
    now_s = time.monotonic()
    monkeypatch.setattr(time, "monotonic", lambda: now_s + LIFETIME_S + 1)
    assert_refused(robot, robot.push(NEW, signed), "within the last 60 s")


def test_a_nonce_is_used_up_by_a_push_that_is_refused(robot: Robot) -> None:
    signed = sign(NEW, robot.nonce())
    assert "has become active" in robot.begin(NEW, signed, expected_active_sha256="").reason
    assert_refused(robot, robot.push(NEW, signed), "nonce")


def test_another_robots_model_is_refused(robot: Robot) -> None:
    signed = sign(NEW, robot.nonce(), robot_id="mbot-2")
    assert_refused(robot, robot.push(NEW, signed), "signed for robot 'mbot-2', this one is")


def test_another_models_manifest_is_refused(robot: Robot) -> None:
    assert_refused(robot, robot.push(NEW, sign(OLD, robot.nonce())), "another model's")
    signed = sign(NEW, robot.nonce(), size_bytes=len(NEW) + 1)
    assert_refused(robot, robot.push(NEW, signed), "another model's")


@pytest.mark.parametrize("below", [0, 1, 10**9])
def test_a_downgrade_is_refused_unless_it_is_signed_as_one(robot: Robot, below: int) -> None:
    floor = robot.floors.of(KEY.public.raw)
    signed = sign(NEW, robot.nonce(), sequence=floor - below)
    assert_refused(robot, robot.push(NEW, signed), f"is not above {floor}, the last one taken")
    allowed = sign(NEW, robot.nonce(), sequence=floor - below, allow_downgrade=True)
    assert robot.push(NEW, allowed).accepted
    assert robot.floors.of(KEY.public.raw) == floor


def test_the_floor_is_on_disk_before_the_model_is_active(robot: Robot) -> None:
    signed = sign(NEW, robot.nonce(), sequence=2**62)
    assert robot.push(NEW, signed).accepted
    again = Robot(robot.directory)
    assert again.floors.of(KEY.public.raw) == 2**62
    assert "is not above" in again.push(OLD).reason


def test_one_persons_clock_does_not_lock_the_other_out(tmp_path: Path) -> None:
    robot = Robot(tmp_path, trust=BOTH)
    assert robot.push(OLD, sign(OLD, robot.nonce(), sequence=2**62)).accepted
    assert robot.push(NEW, sign(NEW, robot.nonce(), OTHER_KEY)).accepted


def test_a_wrong_input_shape_is_refused_before_a_byte_is_sent(robot: Robot) -> None:
    other = Tensor(INPUT_NAME, INPUT_TYPE, (1, 96, 96, 3))
    reply = robot.begin(NEW, sign(NEW, robot.nonce(), input=other))
    assert_refused(robot, reply, "[1, 96, 96, 3], expected 'observation' uint8 [1, 64, 64, 3]")
    other = Tensor("action", "float32", (1, 3))
    reply = robot.begin(NEW, sign(NEW, robot.nonce(), output=other))
    assert_refused(robot, reply, "[1, 3], expected 'action' float32 [1, 2]")


def test_actions_that_mean_something_else_are_refused(robot: Robot) -> None:
    signed = sign(NEW, robot.nonce(), actions="right,left")
    assert_refused(robot, robot.push(NEW, signed), "actions mean 'right,left'")


def test_an_expired_manifest_is_refused_where_the_clock_is_known_to_be_right(
    robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    a_set_clock = tmp_path / "synchronized"
    a_set_clock.touch()
    monkeypatch.setattr(trust, "CLOCK_IS_SET", a_set_clock)
    signed = sign(NEW, robot.nonce(), not_after_unix_s=int(time.time()) - 100)
    assert_refused(robot, robot.push(NEW, signed), "expired 10")
    a_set_clock.unlink()
    signed = sign(NEW, robot.nonce(), not_after_unix_s=1)
    assert robot.push(NEW, signed).accepted


def test_a_clock_that_jumps_by_ten_years_changes_nothing(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(trust, "CLOCK_IS_SET", Path("/nowhere"))
    signed = sign(NEW, robot.nonce(), not_after_unix_s=int(time.time()) + 60)
    real = time.time()
    monkeypatch.setattr(time, "time", lambda: real + 10 * 365 * 86_400)
    assert robot.push(NEW, signed).accepted


def test_a_robot_without_keys_says_what_to_do(tmp_path: Path) -> None:
    robot = Robot(tmp_path, trust=Trust())
    reply = robot.push(NEW)
    assert not reply.accepted
    assert "trusts no signing key yet" in reply.reason
    assert "workstation keys new" in reply.reason
    assert robot.active == ""


def test_the_development_setting_takes_everything_and_says_so(tmp_path: Path) -> None:
    robot = Robot(tmp_path, trust=Trust((), allow_unsigned=True))
    reply = robot.push(NEW, UNSIGNED)
    assert reply.accepted, reply.reason
    assert reply.active_model.signed_by == ""
    assert [notice.kind for notice in robot.notices] == ["unsigned-models"]
    assert Robot(tmp_path).active == ""
    assert Robot(tmp_path, trust=Trust((), allow_unsigned=True)).active == "new"


def test_a_model_whose_key_is_removed_is_not_loaded_any_more(tmp_path: Path) -> None:
    robot = Robot(tmp_path, trust=BOTH)
    assert robot.push(OLD).accepted
    assert robot.push(NEW, sign(NEW, robot.nonce(), OTHER_KEY)).accepted
    assert Robot(tmp_path, trust=BOTH).active == "new"
    only_anna = Robot(tmp_path)
    assert only_anna.active == "old"
    reply = only_anna.activate(digest(NEW)[:8])
    assert not reply.accepted
    assert "not among this robot's [trust] keys" in reply.reason
    assert Robot(tmp_path, trust=Trust()).active == ""
    assert Robot(tmp_path, trust=BOTH).active == "new"


@pytest.mark.parametrize("allow_unsigned", [False, True])
def test_a_copied_card_does_not_drive_another_robot(robot: Robot, allow_unsigned: bool) -> None:
    assert robot.push(NEW).accepted
    trust = Trust((KEY.public.line,), allow_unsigned=allow_unsigned)
    other = Robot(robot.directory, trust=trust, robot_id="other")
    assert (other.active, other.used) == ("", [])
    assert other.notices[-1].kind == "model-unusable"
    assert other.notices[-1].detail == (
        f"new {digest(NEW)[:12]} cannot be used: the model is signed for robot 'mbot-1', this one "
        "is 'other': push it to this one"
    )
    reply = other.activate(digest(OLD)[:8])
    assert not reply.accepted
    assert "signed for robot 'mbot-1'" in reply.reason
    assert Robot(robot.directory).active == "new"


def test_a_robot_with_another_name_drives_again_after_a_push(robot: Robot) -> None:
    renamed = Robot(robot.directory, robot_id="other")
    reply = renamed.push(OLD)
    assert reply.accepted, reply.reason
    assert (renamed.active, renamed.notices) == ("old", ())
    assert Robot(robot.directory, robot_id="other").active == "old"


def test_rotating_a_key_keeps_the_robot_driving(tmp_path: Path) -> None:
    assert Robot(tmp_path).push(OLD).accepted
    both = Robot(tmp_path, trust=BOTH)
    assert both.active == "old"
    assert both.push(OLD, sign(OLD, both.nonce(), OTHER_KEY)).accepted  # the same model again
    only_bert = Robot(tmp_path, trust=Trust((OTHER_KEY.public.line,)))
    assert only_bert.active == "old"


@pytest.mark.parametrize("signed", ["", "rubbish", "AAAA AAAA AAAA", "AAAA AAAA"])
def test_a_stored_manifest_that_was_tampered_with_does_not_count(robot: Robot, signed: str) -> None:
    label = robot.store.label(digest(OLD))
    path = robot.directory / f"{digest(OLD)}.json"
    path.write_text(path.read_text().replace(label.signed, signed))
    assert Robot(robot.directory).active == ""


def test_a_stored_model_cannot_borrow_anothers_signature(robot: Robot) -> None:
    label = robot.store.label(digest(OLD))
    robot.store.add(digest(NEW), NEW, label)
    with pytest.raises(MbotError, match="manifest kept with the model is another's"):
        robot.trust.signer_of(digest(NEW), robot.store.label(digest(NEW)))


def test_a_nonce_is_good_once() -> None:
    nonces = Nonces()
    nonce = nonces.issue()
    assert nonces.use(nonce)
    assert not nonces.use(nonce)
    assert not nonces.use("00" * 16)


def test_a_nonce_is_good_for_a_minute(monkeypatch: pytest.MonkeyPatch) -> None:
    nonces = Nonces()
    early, late = nonces.issue(), nonces.issue()
    issued_s = time.monotonic()
    monkeypatch.setattr(time, "monotonic", lambda: issued_s + LIFETIME_S - 1)
    assert nonces.use(early)
    monkeypatch.setattr(time, "monotonic", lambda: issued_s + LIFETIME_S + 1)
    assert not nonces.use(late)


def test_asking_again_and_again_costs_no_memory() -> None:
    nonces = Nonces()
    first = nonces.issue()
    issued = [nonces.issue() for _ in range(10_000)]
    assert len(set(issued)) == len(issued)
    assert not nonces.use(first)
    assert [nonces.use(nonce) for nonce in issued].count(True) == MOST_OUTSTANDING


def test_another_start_of_the_daemon_knows_none_of_them() -> None:
    assert not Nonces().use(Nonces().issue())


@pytest.mark.parametrize(
    ("settings", "kind"),
    [
        (Trust(allow_unsigned=True), "unsigned-models"),
        (Trust(), "no-trusted-key"),
        (Trust((KEY.public.line,)), ""),
    ],
)
def test_it_is_said_whose_models_are_taken(tmp_path: Path, settings: Trust, kind: str) -> None:
    notice = Robot(tmp_path, trust=settings).trust.notice
    assert (notice.kind if notice else "") == kind
