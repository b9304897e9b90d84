import os
import threading
import time
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mbot_agent.board import board_session
from mbot_agent.board.motors import Motors
from mbot_agent.configuration import Board
from mbot_agent.hardware import DriveCommand
from mbot_protocol.mcore import FLUSH_PADDING, STOP, Joystick

from ..until import until
from .fake_board import FakeBoard

FORWARD = Joystick(-100, 100)
LONG_NS = 10_000_000_000
ASK_VERSION = b"\xff\x55\x03\x00\x01\x00"


def for_ms(milliseconds: float) -> int:
    return time.monotonic_ns() + int(milliseconds * 1e6)


def stays_stopped(board: FakeBoard) -> bool:
    """Until the standing STOP has come twice more."""
    seen = len(board.commands)
    assert until(lambda: len(board.commands) >= seen + 2)
    return not any(m1 or m2 for _, m1, m2 in board.commands[seen:])


@pytest.fixture
def motors(board: FakeBoard) -> Iterator[Motors]:
    with Motors(Board(port=board.path, accept_no_deadman=True)) as running:
        assert until(lambda: running.fault is None)
        yield running


def test_a_command_is_written_and_acknowledged(motors: Motors, board: FakeBoard) -> None:
    before_ns = time.monotonic_ns()
    delivery = motors.delivery(motors.drive(DriveCommand(FORWARD, for_ms(500))), 1.0)
    assert delivery is not None
    assert before_ns <= delivery.written_ns <= delivery.acknowledged_ns
    assert board.speeds == (-100, 100)


def test_the_board_is_stopped_before_anything_else(motors: Motors, board: FakeBoard) -> None:
    assert bytes(board.received).startswith(FLUSH_PADDING + STOP.to_bytes())
    assert not board.moved


def test_a_command_is_refreshed_until_its_deadline_and_no_longer(
    motors: Motors, board: FakeBoard
) -> None:
    deadline_ns = for_ms(450)
    motors.drive(DriveCommand(FORWARD, deadline_ns))
    assert board.wait_for(-100, 100)
    assert board.wait_for(0, 0)
    driven = [at for at, m1, _ in board.commands if m1 != 0]
    assert 3 <= len(driven) <= 6
    assert driven[-1] <= deadline_ns / 1e9 + 0.01
    assert any(at >= deadline_ns / 1e9 for at, m1, _ in board.commands if m1 == 0)


def test_a_guard_that_turns_false_stops_the_motors(motors: Motors, board: FakeBoard) -> None:
    for _ in range(5):  # on a busy machine a lost acknowledgement stops them too, now and then
        fresh = threading.Event()
        fresh.set()
        motors.drive(DriveCommand(FORWARD, for_ms(10_000), guard=fresh.is_set))
        assert board.wait_for(-100, 100)
        fresh.clear()
        assert board.wait_for(0, 0)


def test_stop_and_halt(motors: Motors, board: FakeBoard) -> None:
    motors.drive(DriveCommand(FORWARD, for_ms(10_000)))
    assert board.wait_for(-100, 100)
    motors.stop()
    assert board.wait_for(0, 0)
    motors.drive(DriveCommand(FORWARD, for_ms(10_000)))
    assert board.wait_for(-100, 100)
    motors.halt()
    assert motors.wait_stopped(1.0)
    assert board.speeds == (0, 0)
    motors.drive(DriveCommand(FORWARD, for_ms(10_000)))
    assert stays_stopped(board)


def test_a_stop_is_on_the_wire_within_20_ms(motors: Motors, board: FakeBoard) -> None:
    took_ms: list[float] = []
    for _ in range(3):
        motors.drive(DriveCommand(FORWARD, for_ms(10_000)))
        assert board.wait_for(-100, 100)
        asked_s = time.monotonic()
        motors.stop()
        assert board.wait_for(0, 0)
        stopped_s = next(at for at, m1, _ in board.commands if at >= asked_s and m1 == 0)
        took_ms.append((stopped_s - asked_s) * 1000)
    assert sorted(took_ms)[-2] <= 20


def test_a_stop_is_acknowledged_twice(motors: Motors, board: FakeBoard) -> None:
    motors.drive(DriveCommand(FORWARD, for_ms(10_000)))
    assert board.wait_for(-100, 100)
    mark = len(board.received)
    motors.stop()
    assert motors.stands(1.0)
    assert bytes(board.received[mark:]).startswith(2 * (FLUSH_PADDING + STOP.to_bytes()))


def test_that_it_stands_is_the_boards_word(motors: Motors, board: FakeBoard) -> None:
    assert motors.stands(1.0)
    motors.drive(DriveCommand(FORWARD, for_ms(10_000)))
    assert board.wait_for(-100, 100)
    motors.stop()
    assert motors.stands(1.0)
    assert board.speeds == (0, 0)
    board.acknowledge = False
    assert not motors.stands(0.1)


def test_a_lost_board_stands_for_nobody_and_says_so_at_once(
    motors: Motors, board: FakeBoard
) -> None:
    motors.drive(DriveCommand(FORWARD, for_ms(10_000)))
    assert board.wait_for(-100, 100)
    board.unplug()
    assert until(lambda: motors.fault is not None)
    began_s = time.monotonic()
    assert not motors.stands(5.0)
    assert time.monotonic() - began_s < 1.0


def test_leaving_the_context_stops_the_motors(board: FakeBoard) -> None:
    with Motors(Board(port=board.path, accept_no_deadman=True)) as motors:
        assert until(lambda: motors.fault is None)
        motors.drive(DriveCommand(FORWARD, for_ms(10_000)))
        assert board.wait_for(-100, 100)
    assert board.speeds == (0, 0)


def test_stock_firmware_drives_only_when_accepted(board: FakeBoard) -> None:
    with Motors(Board(port=board.path)) as motors:
        assert until(lambda: motors.version != "")
        assert motors.fault is not None
        assert motors.fault.kind == "board-no-deadman"
        motors.drive(DriveCommand(FORWARD, for_ms(10_000)))
        assert stays_stopped(board)
        assert not board.moved


def test_firmware_with_a_deadman_drives_without_asking() -> None:
    with FakeBoard("mbot-deadman 1") as board, Motors(Board(port=board.path)) as motors:
        assert until(lambda: motors.fault is None)
        motors.drive(DriveCommand(FORWARD, for_ms(500)))
        assert board.wait_for(-100, 100)


def test_a_reset_board_is_not_driven_before_a_new_handshake(
    motors: Motors, board: FakeBoard
) -> None:
    motors.drive(DriveCommand(FORWARD, for_ms(10_000)))
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
    motors.drive(DriveCommand(FORWARD, for_ms(10_000)))
    assert board.wait_for(-100, 100)
    board.mute = True
    assert until(lambda: motors.fault is not None)
    board.mute = False
    assert until(lambda: motors.fault is None)
    assert board.wait_for(0, 0)


def test_a_lost_acknowledgement_stops_until_the_next_command(
    motors: Motors, board: FakeBoard
) -> None:
    motors.drive(DriveCommand(FORWARD, for_ms(10_000)))
    assert board.wait_for(-100, 100)
    board.acknowledge = False  # of the next refresh
    assert board.wait_for(0, 0)
    board.acknowledge = True
    assert until(lambda: motors.fault is None)
    assert stays_stopped(board)
    motors.drive(DriveCommand(FORWARD, for_ms(10_000)))
    assert board.wait_for(-100, 100)


def test_unplugging_is_noticed_and_plugging_in_mended(tmp_path: object) -> None:
    link = os.path.join(str(tmp_path), "board")  # noqa: PTH118
    first, second = FakeBoard(), FakeBoard()
    os.symlink(first.path, link)  # noqa: PTH211
    with first, second, Motors(Board(port=link, accept_no_deadman=True)) as motors:
        assert until(lambda: motors.fault is None)
        motors.drive(DriveCommand(FORWARD, for_ms(10_000)))
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
    with Motors(Board(port=board.path, accept_no_deadman=True)) as second:
        assert until(lambda: second.fault is not None and "in use" in second.fault.detail)
    assert motors.fault is None


@pytest.mark.parametrize(
    ("port", "words"), [("/dev/nothing-here", "is it plugged in"), ("/dev/null", "cannot open")]
)
def test_a_wrong_port_is_explained(port: str, words: str) -> None:
    with Motors(Board(port=port)) as motors:
        assert until(lambda: motors.fault is not None and words in motors.fault.detail)


def test_a_silent_device_never_gets_a_drive_frame(
    board: FakeBoard, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(board_session, "HANDSHAKE_TIMEOUT_S", 0.5)
    board.mute = True
    with Motors(Board(port=board.path, accept_no_deadman=True)) as motors:
        assert until(lambda: motors.fault is not None and "baud" in motors.fault.detail)
        motors.drive(DriveCommand(FORWARD, for_ms(10_000)))
        asked = bytes(board.received).count(ASK_VERSION)
        assert until(lambda: bytes(board.received).count(ASK_VERSION) >= asked + 2)
    assert FORWARD.to_bytes() not in bytes(board.received)


@settings(max_examples=60)
@given(st.binary(min_size=1, max_size=80))
def test_garbage_from_the_board_ends_stopped(garbage: bytes) -> None:
    with FakeBoard() as board, Motors(Board(port=board.path, accept_no_deadman=True)) as motors:
        assert until(lambda: motors.fault is None)
        motors.drive(DriveCommand(FORWARD, for_ms(10_000)))
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
    read = board_session.BoardSession._read  # pyright: ignore[reportPrivateUsage]

    def counted(*arguments: Any, **named: Any) -> Any:
        nonlocal looks
        looks += 1
        return read(*arguments, **named)

    monkeypatch.setattr(board_session, "HANDSHAKE_TIMEOUT_S", 0.6)
    monkeypatch.setattr(board_session.BoardSession, "_read", counted)
    board.mute = True
    with Motors(Board(port=board.path, accept_no_deadman=True)) as motors:
        motors.drive(DriveCommand(FORWARD, for_ms(10_000)))
        assert until(lambda: motors.fault is not None and "baud" in motors.fault.detail)
    assert looks < 20


def test_only_the_last_delivery_is_kept(motors: Motors, board: FakeBoard) -> None:
    """A hand asks for none of them."""
    for _ in range(20):
        motors.drive(DriveCommand(FORWARD, for_ms(500)))
        time.sleep(0.005)
    ticket = motors.drive(DriveCommand(FORWARD, for_ms(500)))
    assert motors.delivery(ticket, 1.0) is not None
    kept = motors._delivery  # pyright: ignore[reportPrivateUsage]
    assert kept is not None
    assert kept[0] == ticket
    assert motors.delivery(ticket - 1, 0.01) is None
