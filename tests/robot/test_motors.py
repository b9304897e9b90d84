import logging
import os
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mbot_agent.board import board_kinds
from mbot_agent.board import motors as motors_module
from mbot_agent.board.mcore import mcore_port, mcore_session
from mbot_agent.board.mcore.mcore_session import McoreSession
from mbot_agent.board.motors import IDLE_HEARTBEAT_S, REFRESH_S, Motors
from mbot_agent.configuration import BoardSettings, SensesSettings
from mbot_agent.process.watchdog import LONGEST_PAUSE_NS
from mbot_protocol.drive.actions import MotorMap, WheelMaps
from mbot_protocol.drive.mcore import ARM_REQUEST, FLUSH_PADDING, STOP, Joystick, senses_request
from mbot_protocol.drive.wheel_command import Duties, WheelCommand
from mbot_protocol.errors import ConfigurationError

from ..until import until
from .fake_board import FakeBoard

FORWARD = Joystick(-100, 100)
AHEAD = FORWARD.duties
LONG_NS = 10_000_000_000
ASK_VERSION = b"\xff\x55\x03\x00\x01\x00"


def for_ms(milliseconds: float) -> int:
    return time.monotonic_ns() + int(milliseconds * 1e6)


def stays_stopped(board: FakeBoard) -> bool:
    """Until the standing STOP has come twice more."""
    seen = len(board.commands)
    assert until(lambda: len(board.commands) >= seen + 2)
    return not any(m1 or m2 for _, m1, m2 in board.commands[seen:])


@pytest.fixture(autouse=True)
def brisk(monkeypatch: pytest.MonkeyPatch) -> None:
    """That it stands is said more often than else, and the tests take less time."""
    monkeypatch.setattr(motors_module, "IDLE_HEARTBEAT_S", 0.1)


@pytest.fixture
def motors(board: FakeBoard) -> Iterator[Motors]:
    with Motors(BoardSettings(port=board.path, accept_no_deadman=True)) as running:
        assert until(lambda: running.fault is None)
        yield running


def test_a_command_is_written_and_acknowledged(motors: Motors, board: FakeBoard) -> None:
    before_ns = time.monotonic_ns()
    ticket = motors.drive(WheelCommand(AHEAD, for_ms(500)))
    delivery = motors.delivery(ticket, 10.0)
    assert time.monotonic_ns() - before_ns < 5 * 10**9, "told at once"
    assert delivery is not None
    assert before_ns <= delivery.written_ns <= delivery.acknowledged_ns
    assert board.speeds == (-100, 100)
    assert until(lambda: len([m1 for _, m1, _ in board.commands if m1]) >= 3)
    assert motors.delivery(ticket, 1.0) == delivery, "repeating it changes nothing"


def test_the_board_is_stopped_before_anything_else(motors: Motors, board: FakeBoard) -> None:
    assert bytes(board.received).startswith(FLUSH_PADDING + STOP.to_bytes())
    assert not board.moved


def test_a_command_is_refreshed_until_its_deadline_and_no_longer(
    motors: Motors, board: FakeBoard
) -> None:
    deadline_ns = for_ms(450)
    motors.drive(WheelCommand(AHEAD, deadline_ns))
    assert board.wait_for(-100, 100)
    assert board.wait_for(0, 0)
    driven = [at for at, m1, _ in board.commands if m1 != 0]
    assert 3 <= len(driven) <= 6
    assert driven[-1] <= deadline_ns / 1e9 + 0.01
    assert any(at >= deadline_ns / 1e9 for at, m1, _ in board.commands if m1 == 0)


def test_a_command_ends_at_its_deadline_not_at_the_next_refresh(
    motors: Motors, board: FakeBoard
) -> None:
    late_ms: list[float] = []
    for _ in range(3):
        deadline_ns = for_ms(130)  # the second refresh would be after 200 ms
        motors.drive(WheelCommand(AHEAD, deadline_ns))
        assert board.wait_for(-100, 100)
        assert board.wait_for(0, 0)
        late_ms.append(board.commands[-1][0] * 1e3 - deadline_ns / 1e6)
    assert sorted(late_ms)[-2] <= 30


def test_a_guard_that_turns_false_stops_the_motors(motors: Motors, board: FakeBoard) -> None:
    for _ in range(5):  # on a busy machine a lost acknowledgement stops them too, now and then
        fresh = threading.Event()
        fresh.set()
        motors.drive(WheelCommand(AHEAD, for_ms(10_000), guard=fresh.is_set))
        assert board.wait_for(-100, 100)
        fresh.clear()
        assert board.wait_for(0, 0)


def test_stop_and_halt(motors: Motors, board: FakeBoard) -> None:
    motors.drive(WheelCommand(AHEAD, for_ms(10_000)))
    assert board.wait_for(-100, 100)
    motors.stop()
    assert board.wait_for(0, 0)
    motors.drive(WheelCommand(AHEAD, for_ms(10_000)))
    assert board.wait_for(-100, 100)
    motors.halt()
    assert motors.wait_stopped(1.0)
    assert board.speeds == (0, 0)
    motors.drive(WheelCommand(AHEAD, for_ms(10_000)))
    assert stays_stopped(board)


def test_a_stop_is_on_the_wire_within_20_ms(motors: Motors, board: FakeBoard) -> None:
    took_ms: list[float] = []
    for _ in range(3):
        motors.drive(WheelCommand(AHEAD, for_ms(10_000)))
        assert board.wait_for(-100, 100)
        asked_s = time.monotonic()
        motors.stop()
        assert board.wait_for(0, 0)
        stopped_s = next(at for at, m1, _ in board.commands if at >= asked_s and m1 == 0)
        took_ms.append((stopped_s - asked_s) * 1000)
    assert sorted(took_ms)[-2] <= 20


def test_a_command_is_on_the_wire_within_20_ms(motors: Motors, board: FakeBoard) -> None:
    took_ms: list[float] = []
    for _ in range(3):
        assert motors.stands(1.0)
        asked_s = time.monotonic()
        motors.drive(WheelCommand(AHEAD, for_ms(10_000)))
        assert board.wait_for(-100, 100)
        took_ms.append((board.commands[-1][0] - asked_s) * 1000)
        motors.stop()
        assert board.wait_for(0, 0)
    assert sorted(took_ms)[-2] <= 20


def test_the_end_of_the_daemon_stops_the_motors_within_20_ms() -> None:
    took_ms: list[float] = []
    for _ in range(3):
        with (
            FakeBoard() as board,
            Motors(BoardSettings(port=board.path, accept_no_deadman=True)) as motors,
        ):
            assert until(lambda motors=motors: motors.fault is None)
            motors.drive(WheelCommand(AHEAD, for_ms(10_000)))
            assert board.wait_for(-100, 100)
            asked_s = time.monotonic()
            motors.halt()
            assert board.wait_for(0, 0)
            stopped_s = next(at for at, m1, _ in board.commands if at >= asked_s and m1 == 0)
            took_ms.append((stopped_s - asked_s) * 1000)
    assert sorted(took_ms)[-2] <= 20


def test_whoever_stops_the_motors_is_held_up_by_nobody(board: FakeBoard) -> None:
    """Not even by a motor thread that takes no notice: the pipe that wakes it is full by then."""
    motors = Motors(BoardSettings(port=board.path))  # its thread was never started
    assert time.monotonic_ns() - motors.progress_ns < 10**9, "it is not called stuck by that"

    def halt() -> None:
        for _ in range(70_000):
            motors.halt()

    halting = threading.Thread(target=halt, daemon=True)
    halting.start()
    halting.join(20)
    assert not halting.is_alive()


def test_a_board_that_stands_costs_two_stops_a_second(
    motors: Motors, board: FakeBoard, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever was asked of it before."""
    monkeypatch.setattr(motors_module, "IDLE_HEARTBEAT_S", IDLE_HEARTBEAT_S)
    assert IDLE_HEARTBEAT_S == 0.5
    motors.drive(WheelCommand(AHEAD, for_ms(100)))
    assert board.wait_for(-100, 100)
    assert board.wait_for(0, 0)
    assert motors.stands(1.0)
    looks = 0
    wait = McoreSession.wait

    def counted(session: McoreSession, timeout_s: float) -> None:
        nonlocal looks
        looks += 1
        wait(session, timeout_s)

    mark = len(board.received)
    monkeypatch.setattr(McoreSession, "wait", counted)
    time.sleep(1.2)
    said = bytes(board.received[mark:])
    assert said in (2 * STOP.to_bytes(), 3 * STOP.to_bytes())
    assert looks <= 8


def test_a_standing_board_that_dies_is_found_out(motors: Motors, board: FakeBoard) -> None:
    """Before somebody wants to drive it."""
    board.mute = True
    assert until(lambda: motors.fault is not None, 5.0)
    assert motors.version == ""


def test_a_stop_is_acknowledged_twice(motors: Motors, board: FakeBoard) -> None:
    motors.drive(WheelCommand(AHEAD, for_ms(10_000)))
    assert board.wait_for(-100, 100)
    mark = len(board.received)
    motors.stop()
    assert motors.stands(1.0)
    assert bytes(board.received[mark:]).startswith(2 * (FLUSH_PADDING + STOP.to_bytes()))


def test_that_it_stands_is_the_boards_word(
    motors: Motors, board: FakeBoard, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(motors_module, "IDLE_HEARTBEAT_S", 10.0)
    for _ in range(3):
        assert motors.stands(2.0), "asked at once, not when a stop is due anyway"
    motors.drive(WheelCommand(AHEAD, for_ms(10_000)))
    assert board.wait_for(-100, 100)
    motors.stop()
    began_s = time.monotonic()
    assert motors.stands(10.0)
    assert time.monotonic() - began_s < 5.0
    assert board.speeds == (0, 0)
    board.acknowledge = False
    assert not motors.stands(0.1)


def test_who_waits_for_a_board_that_is_just_lost_is_told_at_once(
    motors: Motors, board: FakeBoard
) -> None:
    board.mute = True
    began_s = time.monotonic()
    assert not motors.stands(30.0)
    assert time.monotonic() - began_s < 10.0


def test_a_lost_board_stands_for_nobody_and_says_so_at_once(
    motors: Motors, board: FakeBoard
) -> None:
    motors.drive(WheelCommand(AHEAD, for_ms(10_000)))
    assert board.wait_for(-100, 100)
    board.unplug()
    assert until(lambda: motors.fault is not None)
    began_s = time.monotonic()
    assert not motors.stands(5.0)
    assert time.monotonic() - began_s < 1.0


def test_leaving_the_context_stops_the_motors(board: FakeBoard) -> None:
    with Motors(BoardSettings(port=board.path, accept_no_deadman=True)) as motors:
        assert until(lambda: motors.fault is None)
        motors.drive(WheelCommand(AHEAD, for_ms(10_000)))
        assert board.wait_for(-100, 100)
    assert board.speeds == (0, 0)


def test_stock_firmware_drives_only_when_accepted(
    board: FakeBoard, caplog: pytest.LogCaptureFixture
) -> None:
    with Motors(BoardSettings(port=board.path)) as motors:
        assert until(lambda: motors.version != "")
        assert until(lambda: "keeps driving if this computer dies" in caplog.text)
        assert motors.fault is not None
        assert motors.fault.kind == "board-no-deadman"
        motors.drive(WheelCommand(AHEAD, for_ms(10_000)))
        assert stays_stopped(board)
        assert not board.moved


def test_the_board_is_told_what_to_feel_and_what_forward_is() -> None:
    settings = SensesSettings(edge="stop", line_ports=(1,), ultrasonic_port=4)
    wheels = WheelMaps(MotorMap(reversed=False), MotorMap(reversed=False))
    with (
        FakeBoard("mbot-deadman 3 300ms") as board,
        Motors(BoardSettings(port=board.path), wheels, settings) as motors,
    ):
        assert until(lambda: motors.fault is None)
        asked = senses_request((1,), 4, 0.0, wheels, edge_stops=True)
        assert asked in board.received
        board.feel(4000, 0b11)
        assert until(lambda: motors.senses is not None)


def test_firmware_with_a_deadman_drives_without_asking() -> None:
    with FakeBoard("mbot-deadman 1") as board, Motors(BoardSettings(port=board.path)) as motors:
        assert until(lambda: motors.fault is None)
        motors.drive(WheelCommand(AHEAD, for_ms(500)))
        assert board.wait_for(-100, 100)


def test_a_reset_board_is_not_driven_before_a_new_handshake(
    motors: Motors, board: FakeBoard
) -> None:
    motors.drive(WheelCommand(AHEAD, for_ms(10_000)))
    assert board.wait_for(-100, 100)
    mark = len(board.received)
    board.reset()
    assert until(lambda: ASK_VERSION in bytes(board.received[mark:]))
    assert motors.resets == 1
    assert until(lambda: motors.fault is None)
    # The command in force is forgotten: whoever wants to drive on must say so again.
    assert stays_stopped(board)


def test_a_mute_board_is_a_fault_and_gets_stopped_when_it_is_back(
    motors: Motors, board: FakeBoard
) -> None:
    motors.drive(WheelCommand(AHEAD, for_ms(10_000)))
    assert board.wait_for(-100, 100)
    board.mute = True
    assert until(lambda: motors.fault is not None)
    board.mute = False
    assert until(lambda: motors.fault is None)
    assert board.wait_for(0, 0)


def test_a_lost_acknowledgement_stops_until_the_next_command(
    motors: Motors, board: FakeBoard
) -> None:
    """It may or may not have obeyed; another one may still work, so the port stays open."""
    for _ in range(3):
        motors.drive(WheelCommand(AHEAD, for_ms(10_000)))
        assert board.wait_for(-100, 100)
        mark = len(board.received)
        board.unheard_drives = 1  # the next refresh
        assert board.wait_for(0, 0)
        assert stays_stopped(board)
        said = bytes(board.received[mark:])
        stop = 2 * (FLUSH_PADDING + STOP.to_bytes())
        assert said.partition(stop)[0] in (FORWARD.to_bytes(), 2 * FORWARD.to_bytes())
        assert said.endswith(STOP.to_bytes())
        assert ASK_VERSION not in said
    assert motors.resets == 0


def test_a_newer_command_outlives_the_loss_of_an_older_one(
    motors: Motors, board: FakeBoard
) -> None:
    for _ in range(3):
        assert until(lambda: motors.fault is None)
        board.unheard_drives = 1
        motors.drive(WheelCommand(AHEAD, for_ms(10_000)))
        assert until(lambda: board.unheard_drives == 0)
        motors.drive(WheelCommand(Joystick(-50, 50).duties, for_ms(10_000)))
        assert board.wait_for(-50, 50)
        motors.stop()
        assert board.wait_for(0, 0)


def test_a_board_that_obeys_nothing_but_stops_is_reopened(motors: Motors, board: FakeBoard) -> None:
    """As long as somebody tells it to drive, all the time as a hand does."""
    board.latched = True
    mark = len(board.received)

    def drives() -> bool:
        motors.drive(WheelCommand(AHEAD, for_ms(500)))
        return ASK_VERSION in bytes(board.received[mark:])

    assert until(drives)
    assert not board.moved


def test_unplugging_is_noticed_and_plugging_in_mended(tmp_path: object) -> None:
    link = os.path.join(str(tmp_path), "board")  # noqa: PTH118
    first, second = FakeBoard(), FakeBoard()
    os.symlink(first.path, link)  # noqa: PTH211
    with first, second, Motors(BoardSettings(port=link, accept_no_deadman=True)) as motors:
        assert until(lambda: motors.fault is None)
        motors.drive(WheelCommand(AHEAD, for_ms(10_000)))
        assert first.wait_for(-100, 100)
        os.remove(link)  # noqa: PTH107
        first.unplug()
        assert until(lambda: motors.fault is not None)
        fault = motors.fault
        assert fault is not None
        assert fault.kind == "board-lost"
        os.symlink(second.path, link)  # noqa: PTH211
        assert until(lambda: motors.fault is None)
        assert not second.moved


def test_a_second_process_is_kept_out(motors: Motors, board: FakeBoard) -> None:
    with Motors(BoardSettings(port=board.path, accept_no_deadman=True)) as second:
        assert until(lambda: second.fault is not None and "in use" in second.fault.detail)
    assert motors.fault is None


@pytest.mark.parametrize(
    ("port", "words"), [("/dev/nothing-here", "is it plugged in"), ("/dev/null", "cannot open")]
)
def test_a_wrong_port_is_explained(port: str, words: str) -> None:
    with Motors(BoardSettings(port=port)) as motors:
        assert until(lambda: motors.fault is not None and words in motors.fault.detail)


def test_a_silent_device_never_gets_a_drive_frame(
    board: FakeBoard, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mcore_session, "HANDSHAKE_TIMEOUT_S", 0.5)
    board.mute = True
    with Motors(BoardSettings(port=board.path, accept_no_deadman=True)) as motors:
        assert until(lambda: motors.fault is not None and "baud" in motors.fault.detail)
        motors.drive(WheelCommand(AHEAD, for_ms(10_000)))
        asked = bytes(board.received).count(ASK_VERSION)
        assert until(lambda: bytes(board.received).count(ASK_VERSION) >= asked + 2)
    assert FORWARD.to_bytes() not in bytes(board.received)


@settings(max_examples=60)
@given(st.binary(min_size=1, max_size=80))
def test_garbage_from_the_board_ends_stopped(garbage: bytes) -> None:
    with (
        FakeBoard() as board,
        Motors(BoardSettings(port=board.path, accept_no_deadman=True)) as motors,
    ):
        assert until(lambda: motors.fault is None)
        motors.drive(WheelCommand(AHEAD, for_ms(10_000)))
        board.say(garbage)
        motors.stop()
        assert until(lambda: board.speeds == (0, 0) and motors.fault is None)
        motors.halt()
        assert motors.wait_stopped(2.0)
        assert board.speeds == (0, 0)


def test_waiting_for_a_board_is_not_spinning(
    board: FakeBoard, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Somebody wants to drive meanwhile, which wakes the thread when it serves."""
    looks = 0
    read = McoreSession._read  # pyright: ignore[reportPrivateUsage]

    def counted(*arguments: Any, **named: Any) -> Any:
        nonlocal looks
        looks += 1
        return read(*arguments, **named)

    monkeypatch.setattr(mcore_session, "HANDSHAKE_TIMEOUT_S", 0.6)
    monkeypatch.setattr(McoreSession, "_read", counted)
    board.mute = True
    with Motors(BoardSettings(port=board.path, accept_no_deadman=True)) as motors:
        motors.drive(WheelCommand(AHEAD, for_ms(10_000)))
        assert until(lambda: motors.fault is not None and "baud" in motors.fault.detail)
    assert looks < 20


@pytest.fixture
def latching() -> Iterator[tuple[Motors, FakeBoard]]:
    """Firmware that refuses to drive after a reset or a silence until it is armed."""
    with (
        FakeBoard("mbot-deadman 2 300ms") as board,
        Motors(BoardSettings(port=board.path)) as motors,
    ):
        assert until(lambda: motors.fault is None)
        yield motors, board


def times_armed(board: FakeBoard) -> int:
    return bytes(board.received).count(ARM_REQUEST)


def test_a_board_that_latches_is_armed_by_a_word_and_once(
    latching: tuple[Motors, FakeBoard],
) -> None:
    motors, board = latching
    motors.drive(WheelCommand(AHEAD, for_ms(10_000)))
    assert stays_stopped(board)
    assert times_armed(board) == 0, "nobody has said a word"
    motors.arm()
    assert stays_stopped(board)
    assert times_armed(board) == 0, "there is nothing to drive"
    for _ in range(3):
        motors.drive(WheelCommand(AHEAD, for_ms(500)))
        assert board.wait_for(-100, 100)
        motors.stop()
        assert board.wait_for(0, 0)
    assert times_armed(board) == 1


@pytest.mark.parametrize("how", ["disarmed", "reset", "lost"])
def test_a_word_is_not_kept_for_a_board_that_comes_back(
    latching: tuple[Motors, FakeBoard], how: str
) -> None:
    """Or that was stopped before it was driven."""
    motors, board = latching
    motors.arm()
    if how == "disarmed":
        motors.disarm()
    elif how == "reset":
        board.reset()
        assert until(lambda: motors.resets == 1 and motors.fault is None)
    else:
        board.mute = True
        assert until(lambda: motors.fault is not None)
        board.mute = False
        assert until(lambda: motors.fault is None)
    for _ in range(2):
        motors.drive(WheelCommand(AHEAD, for_ms(500)))
        assert stays_stopped(board)
    assert times_armed(board) == 0
    assert not board.moved


def test_that_a_board_has_latched_is_found_out_and_one_lost_command_is_not_it(
    latching: tuple[Motors, FakeBoard], monkeypatch: pytest.MonkeyPatch
) -> None:
    # With 50 ms a machine that stalls loses the board now and then, and the count starts over.
    monkeypatch.setattr(mcore_session, "ACKNOWLEDGE_TIMEOUT_S", 0.3)
    motors, board = latching
    motors.arm()

    def refused() -> None:
        motors.drive(WheelCommand(AHEAD, for_ms(10_000)))
        assert until(lambda: FORWARD.to_bytes() in bytes(board.received[mark:]))
        assert stays_stopped(board)

    for _ in range(2):
        motors.drive(WheelCommand(AHEAD, for_ms(500)))
        assert board.wait_for(-100, 100)
        motors.stop()
        assert motors.stands(1.0)
        board.unheard_drives = 1
        mark = len(board.received)
        refused()
        assert motors.resets == 0
    motors.drive(WheelCommand(AHEAD, for_ms(500)))
    assert board.wait_for(-100, 100)
    motors.stop()
    assert motors.stands(1.0)
    board.latched = True
    for resets in (0, 1, 1, 2):
        mark = len(board.received)
        refused()
        assert until(lambda n=resets: motors.resets == n, 5)
    assert motors.fault is None


def test_refusals_that_follow_at_once_are_a_latch_too_and_no_lost_board(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The stop between them was acknowledged, so the board is there."""
    monkeypatch.setattr(mcore_session, "ACKNOWLEDGE_TIMEOUT_S", 0.3)
    monkeypatch.setattr(motors_module, "IDLE_HEARTBEAT_S", 30.0)
    with (
        FakeBoard("mbot-deadman 2 300ms") as board,
        Motors(BoardSettings(port=board.path)) as motors,
    ):
        assert until(lambda: motors.fault is None)
        board.latched = True
        for _ in range(2):  # the second one while the first one's acknowledgement is waited for
            motors.drive(WheelCommand(AHEAD, for_ms(10_000)))
            assert until(lambda: FORWARD.to_bytes() in bytes(board.received), 5)
        assert motors.resets == 0
        assert until(lambda: motors.resets == 1, 5)
        assert motors.fault is None
        assert not board.moved


def test_the_first_command_that_is_lost_is_no_latch(latching: tuple[Motors, FakeBoard]) -> None:
    motors, board = latching
    board.latched, board.unheard_drives = False, 1
    motors.drive(WheelCommand(AHEAD, for_ms(10_000)))
    assert until(lambda: board.unheard_drives == 0)
    assert stays_stopped(board)
    assert motors.resets == 0
    assert motors.fault is None


def test_two_commands_refused_in_a_row_are_a_lost_board_where_the_firmware_never_latches(
    motors: Motors, board: FakeBoard, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mcore_session, "ACKNOWLEDGE_TIMEOUT_S", 0.3)
    board.latched = True
    mark = len(board.received)
    for _ in range(2):  # the second one while the first one's acknowledgement is waited for
        motors.drive(WheelCommand(AHEAD, for_ms(10_000)))
        assert until(lambda: FORWARD.to_bytes() in bytes(board.received[mark:]), 5)
    assert until(lambda: ASK_VERSION in bytes(board.received[mark:]), 5)
    assert bytes(board.received).count(FORWARD.to_bytes()) == 2


def test_a_board_that_boots_is_a_fault_meanwhile(motors: Motors, board: FakeBoard) -> None:
    board.mute = True
    board.reset()
    assert until(lambda: motors.resets == 1)
    assert until(lambda: motors.fault is not None, 1.0)
    board.mute = False
    assert until(lambda: motors.fault is None)


def test_a_command_is_refreshed_no_more_often_when_the_thread_is_woken(
    motors: Motors, board: FakeBoard
) -> None:
    """The board's parser fails at 400 commands a second."""
    motors.drive(WheelCommand(AHEAD, for_ms(10_000)))
    assert board.wait_for(-100, 100)
    seen, began_s = len(board.commands), time.monotonic()
    for _ in range(100):
        motors._wake()  # pyright: ignore[reportPrivateUsage]
        time.sleep(0.003)
    passed_s = time.monotonic() - began_s
    assert len(board.commands) - seen <= passed_s / REFRESH_S + 1


def test_stock_firmware_never_latches(motors: Motors, board: FakeBoard) -> None:
    for _ in range(3):
        assert until(lambda: motors.fault is None)
        board.unheard_drives = 1
        motors.drive(WheelCommand(AHEAD, for_ms(10_000)))
        assert until(lambda: board.unheard_drives == 0)
        assert stays_stopped(board)
    assert motors.resets == 0


def test_a_thread_that_waits_is_seen_to_work(board: FakeBoard, tmp_path: Path) -> None:
    """Else the watchdog would end a daemon whose board is just not there."""
    board.mute = True
    link = tmp_path / "board"
    with Motors(BoardSettings(port=str(link))) as motors:

        def works() -> bool:
            now_ns = time.monotonic_ns()
            return until(lambda: motors.progress_ns > now_ns, LONGEST_PAUSE_NS / 1e9)

        assert until(lambda: motors.fault is not None and motors.fault.kind == "board-lost")
        assert works(), "without a port"
        link.symlink_to(board.path)
        assert until(lambda: ASK_VERSION in bytes(board.received))
        assert works(), "without an answer"
        board.mute = False
        assert until(lambda: motors.version != "")
        for _ in range(2):
            assert works(), "standing"


def test_a_port_that_is_not_there_is_looked_for_now_and_then_and_told_of_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    looks = 0
    find_port = mcore_port.find_port

    def counted(configured: str) -> str:
        nonlocal looks
        looks += 1
        return find_port(configured)

    monkeypatch.setattr(mcore_port, "find_port", counted)
    with Motors(BoardSettings(port=str(tmp_path / "board"))) as motors:
        assert until(lambda: looks >= 3)
        assert looks == 3
        assert motors.wait_stopped(0.1), "there is nothing to wait for"
        began_s = time.monotonic()
    assert time.monotonic() - began_s < 0.5, "closing does not wait for the next look"
    assert len([one for one in caplog.records if one.levelno >= logging.WARNING]) == 1


def test_a_driven_board_that_is_lost_keeps_nobody_waiting(motors: Motors, board: FakeBoard) -> None:
    motors.drive(WheelCommand(AHEAD, for_ms(10_000)))
    assert board.wait_for(-100, 100)
    board.unplug()
    assert motors.wait_stopped(5.0)


def test_a_thread_that_stumbles_reopens_the_board(
    motors: Motors,
    board: FakeBoard,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    faults: list[str] = []
    send = McoreSession.send

    def stumble(session: McoreSession, motors: Duties) -> tuple[int, int]:
        if motors.right > 0 and not faults:
            faults.append("stumbled")
            raise ZeroDivisionError("by nobody's fault")
        return send(session, motors)

    monkeypatch.setattr(McoreSession, "send", stumble)
    mark = len(board.received)
    motors.drive(WheelCommand(AHEAD, for_ms(10_000)))
    assert until(lambda: motors.fault is not None)
    fault = motors.fault
    assert fault is not None
    assert "by nobody's fault" in fault.detail
    assert motors.wait_stopped(0.1)
    assert until(lambda: motors.fault is None)
    assert FLUSH_PADDING + STOP.to_bytes() in bytes(board.received[mark:])
    assert not board.moved
    assert "the motor thread stumbled" in caplog.text


def test_a_thread_that_stumbles_again_and_again_pauses_between(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def stumble(*_: object) -> McoreSession:
        raise ZeroDivisionError

    monkeypatch.setitem(board_kinds.KINDS, "stumbling", stumble)
    with Motors(BoardSettings(kind="stumbling")):
        time.sleep(0.5)
    assert 1 <= caplog.text.count("the motor thread stumbled") < 10


def test_a_board_that_is_there_again_and_again_is_not_waited_for_ever_longer(
    motors: Motors, board: FakeBoard
) -> None:
    took_s: list[float] = []
    for _ in range(5):
        board.mute = True
        assert until(lambda: motors.fault is not None)
        board.mute = False
        began_s = time.monotonic()
        assert until(lambda: motors.fault is None)
        took_s.append(time.monotonic() - began_s)
    # 0.2 s and a handshake. Waits that doubled would make the last ones long, too.
    assert sorted(took_s)[2] < 1.0


def test_only_the_last_delivery_is_kept(motors: Motors, board: FakeBoard) -> None:
    """A hand asks for none of them."""
    for _ in range(20):
        motors.drive(WheelCommand(AHEAD, for_ms(500)))
        time.sleep(0.005)
    ticket = motors.drive(WheelCommand(AHEAD, for_ms(500)))
    assert motors.delivery(ticket, 1.0) is not None
    kept = motors._delivery  # pyright: ignore[reportPrivateUsage]
    assert kept is not None
    assert kept[0] == ticket
    assert motors.delivery(ticket - 1, 0.01) is None


@pytest.mark.parametrize("version", ["09.01.001", "0e.01.018"])
def test_another_board_of_the_same_maker_is_never_driven(version: str) -> None:
    """It speaks the mCore's protocol, and its motors turn otherwise than told. Not even where no
    dead man's switch is asked for."""
    with (
        FakeBoard(version) as board,
        Motors(BoardSettings(port=board.path, accept_no_deadman=True)) as motors,
    ):
        assert until(lambda: motors.version == version)
        assert motors.fault is not None
        assert motors.fault.kind == "board-other"
        motors.drive(WheelCommand(AHEAD, for_ms(1000)))
        assert motors.stands(1.0), "but it is stopped as any other"
        assert not board.moved


def test_closing_does_not_wait_for_the_next_word_to_the_board(
    board: FakeBoard, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(motors_module, "IDLE_HEARTBEAT_S", 10.0)
    motors = Motors(BoardSettings(port=board.path, accept_no_deadman=True))
    assert motors.fault is not None
    assert motors.fault.kind == "board-starting"
    with motors:
        assert until(lambda: motors.fault is None)
        assert motors.stands(5.0)
        began_s = time.monotonic()
    assert time.monotonic() - began_s < 1.5
    assert not any(thread.name == "motors" for thread in threading.enumerate())


def test_a_board_that_is_not_there_costs_no_processor() -> None:
    with Motors(BoardSettings(port="/dev/there-is-none")) as motors:
        assert until(lambda: motors.fault is not None and motors.fault.kind == "board-lost")
        assert processor_share(0.4) < 0.15


@pytest.mark.parametrize("drives", [False, True])
def test_nor_does_one_that_stands_or_is_driven(motors: Motors, drives: bool) -> None:
    assert motors.stands(5.0)  # it has been woken, too
    if drives:
        motors.drive(WheelCommand(AHEAD, for_ms(10_000)))
    assert processor_share(0.4) < 0.15


def processor_share(seconds: float) -> float:
    """Of this process, board and all; a thread that spins takes all that it gets."""
    busy_s, began_s = time.process_time(), time.monotonic()
    time.sleep(seconds)
    return (time.process_time() - busy_s) / (time.monotonic() - began_s)


def test_a_kind_of_board_that_nobody_knows_is_named_at_once() -> None:
    with pytest.raises(ConfigurationError, match=r"board\.kind is 'nocore', expected one of mcore"):
        Motors(BoardSettings(kind="nocore"))


@pytest.mark.parametrize(("left", "right"), [(True, False), (False, True), (False, False)])
def test_a_reversed_motor_runs_backward_when_its_wheel_rolls_forward(
    board: FakeBoard, left: bool, right: bool
) -> None:
    wheels = WheelMaps(MotorMap(left), MotorMap(right))
    with Motors(BoardSettings(port=board.path, accept_no_deadman=True), wheels) as motors:
        assert until(lambda: motors.fault is None)
        motors.drive(WheelCommand(Duties(0.4, 0.2), for_ms(10_000)))
        assert board.wait_for(-102 if left else 102, -51 if right else 51)
