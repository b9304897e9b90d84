"""Rows of the fault table: inference raises or answers nonsense; a new model crashes the daemon."""

import hashlib
import time
from pathlib import Path

import pytest

from mbot_agent.models import model_directory as model_store
from mbot_agent.models import model_keeper
from mbot_agent.models.policy import Policy
from mbot_agent.models.trial import Finding, Verdict
from mbot_protocol.errors import RefusedError

from .model_bench import Robot, digest
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


def test_a_full_disk_does_not_keep_a_robot_from_starting_or_from_going_back(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot.push(SECOND)

    def full(*_: object) -> None:
        raise RefusedError("cannot note which model is active: No space left on device")

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
