"""The state table of docs/arming.md, as far as it is arithmetic."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbot_agent.arming import Hold, Mode, Orders, State, Stop, state_of
from mbot_agent.faults import Fault
from mbot_protocol.errors import RefusedError

WRONG = (Fault("camera-stalled", "no frame"),)
S = 1_000_000_000
ARMED = (Mode.WAITING, Mode.RUNNING, Mode.MANUAL)


@pytest.mark.parametrize(
    ("mode", "faults", "state"),
    [
        (Mode.IDLE, (), State.IDLE),
        (Mode.IDLE, WRONG, State.IDLE),
        (Mode.WAITING, (), State.FAULT),
        (Mode.STOPPED, WRONG, State.STOPPED),
        (Mode.RUNNING, (), State.RUNNING),
        (Mode.RUNNING, WRONG, State.FAULT),
        (Mode.MANUAL, (), State.MANUAL),
        (Mode.MANUAL, WRONG, State.FAULT),
    ],
)
def test_a_fault_shows_only_where_the_robot_should_drive(
    mode: Mode, faults: tuple[Fault, ...], state: State
) -> None:
    assert state_of(mode, faults) is state


@given(st.sampled_from(Mode), st.sampled_from([Mode.RUNNING, Mode.MANUAL]))
def test_who_knows_the_last_stop_may_arm(mode: Mode, wanted: Mode) -> None:
    orders = Orders(mode, stop=Stop(7))
    armed = orders.armed(wanted, 7, 0)
    assert (armed.mode, armed.stop) == (wanted, orders.stop)
    assert armed.epoch > orders.epoch


@given(st.sampled_from(Mode), st.integers(0, 20), st.sampled_from(ARMED))
def test_who_knows_an_older_stop_arms_nothing(mode: Mode, older: int, wanted: Mode) -> None:
    orders = Orders(mode, stop=Stop(20)).stopped(5 * S, by="max")
    with pytest.raises(RefusedError):
        orders.armed(wanted, older, 5 * S)


def test_the_refusal_says_who_and_when() -> None:
    orders = Orders(Mode.RUNNING).stopped(5 * S, by="max")
    with pytest.raises(RefusedError, match=r"stopped by max 0\.4 s ago; look, then run again"):
        orders.armed(Mode.RUNNING, 1, 5 * S + 400_000_000)
    latched = Orders(Mode.RUNNING).stopped(5 * S, why="the board was reset")
    with pytest.raises(RefusedError, match=r"stopped 2\.0 s ago \(the board was reset\)"):
        latched.armed(Mode.MANUAL, 1, 7 * S)
    with pytest.raises(RefusedError, match="upgrade the workstation"):
        latched.armed(Mode.MANUAL, 0, 7 * S)


@given(st.lists(st.sampled_from(["stop", "latch", "run", "wait", "drive", "ready", "release"])))
def test_no_sequence_of_events_moves_a_robot_without_a_word_after_the_last_stop(
    events: list[str],
) -> None:
    """What was sent before a stop names an older count, whatever has happened since."""
    orders = Orders(Mode.IDLE)
    sent_before = orders.stop.count
    for event in events:
        if event in ("stop", "latch"):
            sent_before = orders.stop.count
            orders = orders.stopped(0, by="max" if event == "stop" else "", why="x")
            assert not orders.is_armed
            assert not orders.ready().is_armed
            assert not orders.released(0).is_armed
            with pytest.raises(RefusedError):
                orders.armed(Mode.RUNNING, sent_before, 0)
        elif event in ("run", "wait", "drive"):
            mode = {"run": Mode.RUNNING, "wait": Mode.WAITING, "drive": Mode.MANUAL}[event]
            orders = orders.armed(mode, orders.stop.count, 0)
        elif event == "ready":
            was = orders
            orders = orders.ready()
            assert orders.is_armed == was.is_armed
        else:
            orders = orders.released(9)
            assert orders.mode is not Mode.MANUAL


def test_a_hand_that_lets_go_may_take_hold_again_and_nothing_else_moves() -> None:
    orders = Orders(Mode.RUNNING).armed(Mode.MANUAL, 1, 0).released(9)
    assert orders.mode is Mode.STOPPED
    assert orders.ready().mode is Mode.STOPPED
    assert orders.armed(Mode.MANUAL, 1, 0).mode is Mode.MANUAL


def test_a_hand_that_let_go_is_remembered_until_something_else_is_why_it_stands() -> None:
    orders = Orders(Mode.RUNNING).stopped(5, by="max").armed(Mode.MANUAL, 2, 0).released(9)
    assert (orders.let_go_ns, orders.stop.by) == (9, "max")
    assert orders.released(10) == orders
    assert orders.stopped(11, by="anna").let_go_ns == 0
    assert orders.armed(Mode.RUNNING, 2, 11).let_go_ns == 0
    assert Orders(Mode.RUNNING).released(9).let_go_ns == 0


def test_a_short_gap_is_forgiven_and_a_long_one_is_not() -> None:
    hold = Hold(2.0)
    assert hold.too_long(WRONG, 10 * S) is None
    assert hold.too_long(WRONG, 12 * S) is None
    assert hold.too_long((), 12 * S) is None
    assert hold.too_long(WRONG, 13 * S) is None
    assert hold.too_long(WRONG, 15 * S + 1) == WRONG[0]


def test_a_stop_outdates_what_was_begun_before_it() -> None:
    orders = Orders(Mode.STOPPED, epoch=3)
    again = orders.stopped(0)
    assert again.epoch > orders.epoch
