import time

import pytest

from mbot_agent.arming import Mode, Orders
from mbot_agent.helm import MOST_SENDERS, Helm, Press
from mbot_protocol.drive.wheel_command import Duties, WheelCommand
from mbot_protocol.errors import RefusedError

from .loop_bench import HAND, ObedientBoard

FORWARD = Duties(0.4, 0.4)


@pytest.fixture
def motors() -> ObedientBoard:
    return ObedientBoard()


def helm_of(motors: ObedientBoard, mode: Mode = Mode.IDLE) -> Helm:
    return Helm(motors, Orders(mode))


def held(helm: Helm, press: Press = HAND, hold_ns: int = 10**9) -> None:
    helm.steer_by_hand(FORWARD, time.monotonic_ns() + hold_ns, helm.orders.stop.count, press)


def test_a_decision_begun_before_a_stop_never_reaches_the_motors(motors: ObedientBoard) -> None:
    helm = helm_of(motors)
    helm.run(helm.orders.stop.count)
    orders = helm.orders
    helm.stop()
    assert helm.steer_by_policy(orders, WheelCommand(FORWARD, 0)) is None
    assert motors.asked == ["stop"]


def test_a_decision_begun_before_stop_and_run_again_is_outdated_too(
    motors: ObedientBoard,
) -> None:
    helm = helm_of(motors, Mode.RUNNING)
    orders = helm.orders
    helm.stop()
    helm.run(helm.orders.stop.count)
    assert helm.steer_by_policy(orders, WheelCommand(FORWARD, 0)) is None
    assert helm.steer_by_policy(helm.orders, WheelCommand(FORWARD, 0)) is not None


def test_resting_for_old_orders_does_not_stop_a_hand(motors: ObedientBoard) -> None:
    helm = helm_of(motors, Mode.RUNNING)
    orders = helm.orders
    held(helm)
    helm.rest(orders)
    assert motors.asked == [FORWARD]


def test_a_hand_that_lets_go_has_stopped(
    motors: ObedientBoard, monkeypatch: pytest.MonkeyPatch
) -> None:
    helm = helm_of(motors, Mode.RUNNING)
    now_ns = time.monotonic_ns()
    monkeypatch.setattr(time, "monotonic_ns", lambda: now_ns)
    held(helm, hold_ns=200_000_000)
    assert motors.commands[-1].deadline_ns == now_ns + 200_000_000
    now_ns += 199_999_999
    helm.end_manual_if_due()
    assert helm.orders.mode is Mode.MANUAL
    now_ns += 1  # from here on the motor thread does not drive by it either
    helm.end_manual_if_due()
    assert helm.orders.mode is Mode.STOPPED
    assert motors.asked == [FORWARD, "stop"]
    assert motors.disarmed == 1


def test_run_takes_over_from_a_hand_standing(motors: ObedientBoard) -> None:
    helm = helm_of(motors)
    held(helm)
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
    assert motors.armed == 0  # nobody has said anything yet
    if word == "run":
        helm.run(helm.orders.stop.count)
    elif word == "drive":
        for _ in range(3):  # a hand says it again and again; the board needs it once
            held(helm)
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


@pytest.mark.parametrize("end", ["stop", "latch", "run", "let go", "its time", "another hand"])
def test_whatever_ends_a_press_ends_it_for_good(motors: ObedientBoard, end: str) -> None:
    helm = helm_of(motors)
    held(helm, hold_ns=0 if end == "its time" else 10**9)
    ends = {
        "stop": helm.stop,
        "latch": lambda: helm.latch("stuck"),
        "run": lambda: helm.run(helm.orders.stop.count),
        "let go": lambda: helm.let_go(HAND),
        "its time": helm.end_manual_if_due,
        "another hand": lambda: held(helm, Press(8, 1)),
    }
    ends[end]()
    orders, asked = helm.orders, list(motors.asked)
    with pytest.raises(RefusedError, match="take hold again"):
        held(helm)
    assert (helm.orders, motors.asked) == (orders, asked)
    held(helm, Press(HAND.sender, HAND.number + 1))


def test_a_hand_that_lets_go_late_stops_nobody_else(motors: ObedientBoard) -> None:
    """Somebody has let the policy drive meanwhile."""
    helm = helm_of(motors)
    held(helm)
    helm.run(helm.orders.stop.count)
    orders, asked = helm.orders, list(motors.asked)
    helm.let_go(HAND)
    assert (helm.orders, motors.asked, motors.disarmed) == (orders, asked, 0)


def test_a_late_command_of_a_hold_that_is_over_moves_nothing(motors: ObedientBoard) -> None:
    """The next beat may be 400 ms away, and the motors have stopped by themselves meanwhile."""
    helm = helm_of(motors)
    held(helm, hold_ns=0)
    with pytest.raises(RefusedError, match="take hold again"):
        held(helm)
    assert helm.orders.mode is Mode.STOPPED
    assert motors.asked == [FORWARD, "stop"]


def test_the_presses_of_the_latest_senders_are_remembered(motors: ObedientBoard) -> None:
    helm = helm_of(motors)
    for sender in range(MOST_SENDERS):
        helm.let_go(Press(sender, 5))
    helm.let_go(Press(0, 3))  # an older one, heard of late: 5 stays over
    helm.let_go(Press(MOST_SENDERS, 1))
    with pytest.raises(RefusedError):
        held(helm, Press(0, 5))
    held(helm, Press(1, 1))  # the one that has been silent for longest is forgotten
    helm.let_go(Press(99, 0))  # who has never taken hold has ended nothing
    held(helm, Press(99, 1))


def test_what_was_waited_for_arms_no_other_orders(motors: ObedientBoard) -> None:
    """A STOP, or another word, may come between the look at the faults and this."""
    helm = helm_of(motors)
    helm.run(helm.orders.stop.count, when_ready=True)
    waiting, motors.armed = helm.orders, 0
    helm.stop()
    helm.begin(waiting)
    assert (helm.orders.mode, motors.armed) == (Mode.STOPPED, 0)
    helm.run(helm.orders.stop.count, when_ready=True)
    helm.begin(waiting)
    assert (helm.orders.mode, motors.armed) == (Mode.WAITING, 1)
    helm.begin(helm.orders)
    assert helm.orders.mode is Mode.RUNNING
