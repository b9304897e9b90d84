"""Rows of the fault table: inference raises or answers nonsense; a new model crashes the daemon."""

import hashlib
import logging
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from mbot_agent.configuration import Trust
from mbot_agent.models import model_directory as model_store
from mbot_agent.models import model_keeper
from mbot_agent.models.trial import Finding, Trial, Verdict
from mbot_agent.models.trust import Admission
from mbot_protocol.errors import RefusedError
from mbot_protocol.files import atomic_file
from mbot_protocol.policy.policy import Policy

from .model_bench import CLEAN_DECISIONS, KEY, Robot, SignedManifest, digest, sign
from .tiny_models import constant_model

FIRST = constant_model(0.1, 0.1, name="first")
SECOND = constant_model(0.2, 0.2, name="second")
THIRD = constant_model(0.3, 0.3, name="third")


@pytest.fixture
def robot(tmp_path: Path) -> Robot:
    """With a proven model."""
    robot = Robot(tmp_path)
    robot.push(FIRST)
    robot.decide_well()
    return robot


def test_three_failures_bring_the_previous_model_back(robot: Robot) -> None:
    robot.push(SECOND)
    robot.fail("answered (nan, 0)")
    assert robot.active == "first"
    (notice,) = robot.notices
    assert notice.kind == "model-rolled-back"
    assert notice.detail == (
        f"second {digest(SECOND)[:12]} was rolled back to first {digest(FIRST)[:12]}: "
        "answered (nan, 0)"
    )


def test_a_rolled_back_model_is_not_made_active_again_by_a_restart(robot: Robot) -> None:
    robot.push(SECOND)
    robot.fail()
    again = Robot(robot.directory)
    assert again.active == "first"
    assert [notice.kind for notice in again.notices] == ["model-rolled-back"]
    reply = again.activate()
    assert "no previous model" in reply.reason  # not by a roll-back either, but by its name
    assert again.activate(digest(SECOND)[:8]).accepted
    assert (again.active, again.notices) == ("second", ())


def test_a_proven_model_that_breaks_is_rolled_back_too(robot: Robot) -> None:
    robot.push(SECOND)
    robot.decide_well()
    robot.fail()
    assert robot.active == "first"


def test_an_unproven_previous_model_comes_after_a_proven_older_one(robot: Robot) -> None:
    robot.push(SECOND)
    robot.push(THIRD)
    robot.fail()
    assert robot.active == "first"


def test_the_only_model_stays_though_it_fails(tmp_path: Path) -> None:
    robot = Robot(tmp_path)
    robot.push(FIRST)
    robot.fail()
    assert robot.active == "first"
    assert Robot(tmp_path).active == "first"


def test_a_damaged_previous_model_is_passed_over(robot: Robot) -> None:
    robot.push(SECOND)
    robot.decide_well()
    robot.push(THIRD)
    (robot.directory / f"{digest(SECOND)}.onnx").write_bytes(SECOND[:-5])
    robot.fail()
    assert robot.active == "first"


def test_a_late_verdict_on_a_model_that_was_replaced_changes_nothing(robot: Robot) -> None:
    robot.push(SECOND)
    robot.keeper.carry_out(Verdict(digest(FIRST), Finding.BROKEN, "late"))
    assert robot.active == "second"
    assert robot.notices == ()


def test_a_model_that_crashes_the_daemon_is_rolled_back_within_3_starts(robot: Robot) -> None:
    robot.push(SECOND)  # and with its first decision the daemon is gone
    lives = [Robot(robot.directory) for _ in range(3)]
    assert [life.active for life in lives] == ["second", "second", "first"]
    assert "crashed at its last 2 starts" in lives[-1].notices[0].detail
    assert Robot(robot.directory).active == "first"


def test_so_is_one_that_crashes_it_at_once_on_loading(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot.push(SECOND)

    class Crash(BaseException):
        """The process would be gone."""

    def load(data: bytes) -> Policy:
        if data == SECOND:
            raise Crash
        return Policy(data)

    monkeypatch.setattr(model_keeper, "Policy", load)
    starts = 0
    while True:
        starts += 1
        try:
            found = Robot(robot.directory)
        except Crash:
            continue
        break
    assert (found.active, starts) == ("first", 3)


def test_starts_that_end_in_order_are_not_held_against_a_model(robot: Robot) -> None:
    robot.push(SECOND)
    for _ in range(5):
        with Robot(robot.directory).keeper as keeper:
            assert keeper.active_sha256 == digest(SECOND)
            began_s = time.monotonic()
        assert time.monotonic() - began_s < model_keeper.END_WAIT_S / 2, "nothing to wait for"


def test_nor_are_those_that_lived_without_asking_it(robot: Robot) -> None:
    """A robot whose camera is unplugged, and which is switched off by its switch."""
    robot.push(SECOND)
    for _ in range(5):
        life = Robot(robot.directory)
        assert life.active == "second"
        for _ in range(5):
            life.trial.idle()
        life.settle()


def test_a_proven_model_is_not_blamed_for_a_few_crashes_nor_where_there_is_no_other(
    robot: Robot,
) -> None:
    assert {Robot(robot.directory).active for _ in range(10)} == {"first"}


def test_the_only_model_is_left_out_when_it_crashes_the_daemon(tmp_path: Path) -> None:
    Robot(tmp_path).push(FIRST)
    lives = [Robot(tmp_path) for _ in range(4)]
    assert [life.active for life in lives] == ["first", "first", "", ""]
    assert lives[-1].notices[0].kind == "model-left-out"
    assert lives[-1].push(SECOND).accepted
    assert Robot(tmp_path).active == "second"


def test_a_crash_loop_through_two_bad_models_ends_at_the_good_one(robot: Robot) -> None:
    robot.push(SECOND)
    robot.push(THIRD)
    names = [Robot(robot.directory).active for _ in range(4)]
    assert names == ["third", "third", "first", "first"]


def test_a_damaged_active_model_gives_way_without_being_forgotten(robot: Robot) -> None:
    robot.push(SECOND)
    path = robot.directory / f"{digest(SECOND)}.onnx"
    path.write_bytes(SECOND[:-5])
    assert Robot(robot.directory).active == "first"
    path.write_bytes(SECOND)
    assert Robot(robot.directory).active == "second"


def full(*_: object) -> None:
    raise RefusedError("cannot note which model is active: No space left on device")


def test_a_full_disk_does_not_keep_a_robot_from_starting_or_from_going_back(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot.push(SECOND)
    monkeypatch.setattr(model_store.ModelDirectory, "change", full)
    life = Robot(robot.directory)
    assert life.active == "second"
    life.fail()
    assert life.active == "first"


def test_verdicts_are_carried_out_by_a_thread(robot: Robot) -> None:
    robot.push(SECOND)
    with robot.keeper:
        for _ in range(3):
            robot.trial.failed("nonsense")
        deadline_s = time.monotonic() + 10
        while robot.active != "first" and time.monotonic() < deadline_s:
            time.sleep(0.005)
        assert robot.active == "first"


def test_a_proven_model_that_was_deleted_does_not_stand_for_one_that_is_there(
    tmp_path: Path,
) -> None:
    robot = Robot(tmp_path, keep=2)
    for data in (FIRST, SECOND):
        robot.push(data)
        robot.decide_well()
    robot.activate(digest(FIRST))
    robot.push(
        THIRD
    )  # the second goes: it is neither active nor previous nor the one to go back to
    robot.push(constant_model(0.4, 0.4, name="fourth"))
    robot.fail()
    assert robot.active == "first"


def test_the_model_to_go_back_to_is_never_deleted(tmp_path: Path) -> None:
    robot = Robot(tmp_path, keep=2)
    robot.push(FIRST)
    robot.decide_well()
    for number in range(6):
        robot.push(constant_model(number / 10, 0.0, name=f"unproven {number}"))
    assert {model.name for model in robot.list().models} == {"first", "unproven 4", "unproven 5"}
    robot.fail()
    assert robot.active == "first"
    assert hashlib.sha256(FIRST).hexdigest() == robot.keeper.active_sha256


def test_a_proven_model_that_crashes_the_daemon_again_and_again_goes_too(robot: Robot) -> None:
    robot.push(SECOND)
    robot.decide_well()
    lives = [Robot(robot.directory) for _ in range(6)]
    assert [life.active for life in lives] == ["second"] * 5 + ["first"]
    assert "crashed 5 times within 10 minutes" in lives[-1].notices[0].detail


def test_a_late_verdict_does_not_go_back_from_what_a_person_wants_now(robot: Robot) -> None:
    robot.push(SECOND)
    robot.decide_well()
    robot.push(THIRD)
    robot.keeper.carry_out(Verdict(digest(SECOND), Finding.BROKEN, "late"))
    assert robot.active == "third"
    assert robot.store.activation.rollback is None


def test_to_have_lived_is_not_to_be_proven(robot: Robot) -> None:
    robot.push(SECOND)
    for _ in range(CLEAN_DECISIONS):
        robot.trial.idle()
    robot.settle()
    model = robot.service.active_model
    assert model is not None
    assert not model.proven
    robot.decide_well()
    model = robot.service.active_model
    assert model is not None
    assert model.proven


def test_what_the_disk_does_not_take_is_not_said_to_be_proven(
    robot: Robot, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    robot.push(SECOND)
    monkeypatch.setattr(model_store.ModelDirectory, "change", full)
    robot.decide_well()
    model = robot.service.active_model
    assert model is not None
    assert not model.proven
    assert "the model's proof was not noted: cannot note which" in caplog.messages[-1]


def test_a_proven_model_is_not_on_trial_after_a_restart(robot: Robot) -> None:
    assert not Robot(robot.directory).trial.is_open
    robot.push(SECOND)
    assert Robot(robot.directory).trial.is_open


def test_whoever_changes_the_model_it_is_told_before_it_is_used(robot: Robot) -> None:
    """For it must not set a standing robot in motion."""
    told = [len(robot.changes)]
    robot.used = Told(robot, told)
    robot.push(SECOND)
    robot.activate(digest(FIRST))
    robot.push(THIRD)
    robot.fail()
    assert told == [1, 2, 3, 4, 5]
    assert Robot(robot.directory).changes == [], "a start is no change"


class Told(list[tuple[Policy, Trial]]):
    """At each use, how many changes had been told of by then."""

    def __init__(self, robot: Robot, told: list[int]) -> None:
        super().__init__(robot.used)
        self._robot, self._told = robot, told

    def append(self, one: tuple[Policy, Trial]) -> None:
        super().append(one)
        self._told.append(len(self._robot.changes))


def test_what_a_push_did_not_know_of_is_not_undone_by_it(robot: Robot) -> None:
    robot.push(SECOND)
    with pytest.raises(RefusedError, match=r"another model .* has become active meanwhile"):
        robot.keeper.install(THIRD, digest(FIRST), Admission())
    assert robot.active == Robot(robot.directory).active == "second"


def test_an_older_push_is_refused_after_a_newer_one(robot: Robot) -> None:
    late = sign(THIRD, robot.nonce())
    robot.push(SECOND)
    assert "is not above" in robot.push(THIRD, late).reason


def test_an_older_push_is_refused_after_a_word_to_go_back(robot: Robot) -> None:
    robot.push(SECOND)
    late = sign(THIRD, robot.nonce())
    assert robot.activate(digest(FIRST)).accepted
    assert "is not above" in robot.push(THIRD, late).reason


def test_an_end_by_an_error_is_no_orderly_one(robot: Robot) -> None:
    robot.push(SECOND)
    names: list[str] = []
    for _ in range(3):
        life = Robot(robot.directory)
        names.append(life.active)
        with pytest.raises(ZeroDivisionError), life.keeper:
            raise ZeroDivisionError
    assert names == ["second", "second", "first"]


def test_what_was_found_before_the_end_is_carried_out(robot: Robot) -> None:
    robot.push(SECOND)
    with robot.keeper:
        for _ in range(CLEAN_DECISIONS):
            robot.trial.idle()
        for _ in range(3):
            robot.trial.failed("nonsense")
    assert Robot(robot.directory).active == "first"


HANGS = """
import sys, time
from pathlib import Path
from mbot_agent.configuration import Trust
from mbot_agent.models import model_keeper
from tests.robot.model_bench import Robot

class Hangs(list):
    def append(self, one):
        self.began = True
        time.sleep(600)

model_keeper.END_WAIT_S = 0.1
robot = Robot(Path(sys.argv[1]), trust=Trust((sys.argv[2],)))
robot.used = hangs = Hangs(robot.used)
with robot.keeper:
    for _ in range(3):
        robot.trial.failed("nonsense")
    while not hasattr(hangs, "began"):
        time.sleep(0.01)
"""


def test_a_change_that_hangs_does_not_hold_up_the_end(robot: Robot) -> None:
    robot.push(SECOND)
    command = [sys.executable, "-c", HANGS, str(robot.directory), KEY.public.line]
    root = Path(__file__).parents[2]
    subprocess.run(command, check=True, cwd=root, timeout=30)


def test_an_end_that_comes_in_the_middle_of_a_change_notes_nothing(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two threads would write the same file."""
    monkeypatch.setattr(model_keeper, "END_WAIT_S", 0.1)
    robot.push(SECOND)
    life = Robot(robot.directory)
    assert life.store.activation.starts != {}
    began, goes_on = threading.Event(), threading.Event()

    def look(_: str) -> tuple[str, ...]:
        began.set()
        goes_on.wait(30)
        return ()

    monkeypatch.setattr(life.store, "successors", look)
    with life.keeper:
        for _ in range(3):
            life.trial.failed("nonsense")
        assert began.wait(10)
    assert life.store.activation.starts != {}
    goes_on.set()


def test_of_two_models_that_cannot_be_used_the_active_ones_reason_is_told(robot: Robot) -> None:
    robot.push(SECOND)
    (robot.directory / f"{digest(SECOND)}.onnx").write_bytes(SECOND[:-5])
    label = robot.directory / f"{digest(FIRST)}.json"
    label.write_text(label.read_text().replace(robot.store.label(digest(FIRST)).signed, ""))
    (notice,) = Robot(robot.directory).notices
    assert notice.kind == "model-unusable"
    assert notice.detail.startswith(f"second {digest(SECOND)[:12]} cannot be used: ")
    assert "without a signature" not in notice.detail


def test_what_an_earlier_life_left_half_written_goes(robot: Robot) -> None:
    half = robot.directory / f"{digest(SECOND)}.onnx.1.2{atomic_file.TEMPORARY}"
    half.write_bytes(SECOND[:-5])
    Robot(robot.directory)
    assert not half.exists()


def named(data: bytes) -> str:
    return f"model {digest(data)[:12]}"


@pytest.fixture
def journal(caplog: pytest.LogCaptureFixture) -> pytest.LogCaptureFixture:
    """What the keeper says."""
    caplog.set_level(logging.WARNING, "mbot_agent.models.model_service")
    caplog.set_level(logging.INFO, "mbot_agent.models.turn")
    return caplog


def test_the_journal_tells_how_a_model_comes_to_be_proven(
    tmp_path: Path, journal: pytest.LogCaptureFixture
) -> None:
    robot = Robot(tmp_path)
    robot.push(FIRST)
    robot.decide_well()
    Robot(tmp_path)
    assert journal.messages == [
        "no model to drive with: `workstation push-model` sends one",
        f"{named(FIRST)} (first, signed by anna) is active, on trial",
        f"{named(FIRST)} has proven itself",
        f"{named(FIRST)} (first, signed by anna) is active",
    ]


def test_the_journal_tells_of_each_way_back(
    robot: Robot, journal: pytest.LogCaptureFixture
) -> None:
    robot.push(SECOND)
    journal.clear()
    robot.fail()
    assert journal.messages[0] == f"{named(SECOND)} is rolled back: nonsense"
    journal.clear()
    Robot(robot.directory)
    assert journal.messages[0] == robot.notices[0].detail, "at each start"
    robot.push(THIRD)
    for _ in range(3):
        journal.clear()
        Robot(robot.directory)
    crashed = "the daemon crashed at its last 2 starts with it"
    assert journal.messages[0] == f"{named(THIRD)} is rolled back: {crashed}"


def test_the_journal_tells_why_there_is_no_way_back(
    tmp_path: Path, journal: pytest.LogCaptureFixture
) -> None:
    robot = Robot(tmp_path)
    robot.push(FIRST)
    robot.fail()
    assert journal.messages[-1] == f"{named(FIRST)} fails and there is no other: nonsense"
    for _ in range(3):
        journal.clear()
        Robot(tmp_path)
    crashed = "the daemon crashed at its last 2 starts with it"
    assert journal.messages[0] == f"{named(FIRST)}: {crashed}, and there is no other"
    robot.decide_well()
    robot.push(SECOND)
    (tmp_path / f"{digest(FIRST)}.onnx").write_bytes(b"damaged")
    journal.clear()
    robot.fail()
    assert journal.messages[0].startswith(f"{named(FIRST)} cannot be used: ")
    (tmp_path / f"{digest(SECOND)}.onnx").write_bytes(b"damaged")
    journal.clear()
    Robot(tmp_path)
    assert journal.messages[0].startswith(f"{named(SECOND)} cannot be used: ")


def test_the_journal_tells_who_has_signed_nothing(
    tmp_path: Path, journal: pytest.LogCaptureFixture
) -> None:
    Robot(tmp_path, trust=Trust(allow_unsigned=True)).push(FIRST, SignedManifest(b"", b"", b""))
    assert f"{named(FIRST)} (first, not signed) is active, on trial" in journal.messages
    (tmp_path / "active.json").write_bytes(b"damaged")
    Robot(tmp_path)  # the store says so in the keeper's turn, and the watch over all tests listens
    assert "is damaged" in str(journal.messages)
