import time

import pytest

from mbot_agent.arming import Mode, Orders
from mbot_agent.hardware import DriveCommand
from mbot_agent.helm import Helm
from mbot_protocol.mcore import Joystick

from .loop_bench import ObedientBoard

FORWARD = Joystick(-100, 100)


@pytest.fixture
def motors() -> ObedientBoard:
    return ObedientBoard()


def helm_of(motors: ObedientBoard, mode: Mode = Mode.IDLE) -> Helm:
    return Helm(motors, Orders(mode))


def test_a_decision_begun_before_a_stop_never_reaches_the_motors(motors: ObedientBoard) -> None:
    helm = helm_of(motors)
    helm.run(helm.orders.stop.count)
    orders = helm.orders
    helm.stop()
    assert helm.steer_by_policy(orders, DriveCommand(FORWARD, 0)) is None
    assert motors.asked == ["stop"]


def test_a_decision_begun_before_stop_and_run_again_is_outdated_too(
    motors: ObedientBoard,
) -> None:
    helm = helm_of(motors, Mode.RUNNING)
    orders = helm.orders
    helm.stop()
    helm.run(helm.orders.stop.count)
    assert helm.steer_by_policy(orders, DriveCommand(FORWARD, 0)) is None
    assert helm.steer_by_policy(helm.orders, DriveCommand(FORWARD, 0)) is not None


def test_resting_for_old_orders_does_not_stop_a_hand(motors: ObedientBoard) -> None:
    helm = helm_of(motors, Mode.RUNNING)
    orders = helm.orders
    helm.steer_by_hand(FORWARD, 10**9, helm.orders.stop.count)
    helm.rest(orders)
    assert motors.asked == [FORWARD]


def test_a_hand_that_lets_go_has_stopped(
    motors: ObedientBoard, monkeypatch: pytest.MonkeyPatch
) -> None:
    helm = helm_of(motors, Mode.RUNNING)
    helm.steer_by_hand(FORWARD, 200_000_000, helm.orders.stop.count)
    helm.end_manual_if_due()
    assert helm.orders.mode is Mode.MANUAL
    later_ns = time.monotonic_ns() + 200_000_000
    monkeypatch.setattr(time, "monotonic_ns", lambda: later_ns)
    helm.end_manual_if_due()
    assert helm.orders.mode is Mode.STOPPED
    assert motors.asked == [FORWARD, "stop"]


def test_run_takes_over_from_a_hand_standing(motors: ObedientBoard) -> None:
    helm = helm_of(motors)
    helm.steer_by_hand(FORWARD, 10**9, helm.orders.stop.count)
    helm.run(helm.orders.stop.count)
    assert motors.asked == [FORWARD, "stop"]
    assert helm.orders.mode is Mode.RUNNING


def test_what_is_latched_says_why_and_stops(motors: ObedientBoard) -> None:
    helm = helm_of(motors, Mode.RUNNING)
    helm.latch("the board was reset")
    assert motors.asked == ["stop"]
    assert helm.orders.mode is Mode.STOPPED
    assert helm.orders.stop.why == "the board was reset"


@pytest.mark.parametrize("mode", [Mode.IDLE, Mode.STOPPED])
def test_a_robot_that_is_not_armed_has_nothing_to_disarm(motors: ObedientBoard, mode: Mode) -> None:
    helm = helm_of(motors, mode)
    helm.latch("the board was reset")
    assert (helm.orders.mode, helm.orders.stop.count) == (mode, 1)


@pytest.mark.parametrize("word", ["run", "drive", "ready"])
def test_the_board_is_armed_by_a_word_and_disarmed_by_a_stop(
    motors: ObedientBoard, word: str
) -> None:
    helm = helm_of(motors)
    helm.rest(helm.orders)
    helm.begin(helm.orders)
    assert motors.armed == 1  # `begin` itself is what comes of a word
    motors.armed = 0
    if word == "run":
        helm.run(helm.orders.stop.count)
    elif word == "drive":
        for _ in range(3):  # a hand says it again and again; the board needs it once
            helm.steer_by_hand(FORWARD, 10**9, helm.orders.stop.count)
    else:
        helm.run(helm.orders.stop.count, when_ready=True)
        motors.armed = 0
        helm.begin(helm.orders)
    assert motors.armed == 1
    helm.stop()
    assert motors.disarmed == 1
    helm.run(helm.orders.stop.count)
    helm.latch("the board was reset")
    assert motors.disarmed == 2
