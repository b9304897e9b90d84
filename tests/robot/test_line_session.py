"""A serial-line board: its lines as values, then one connection on a pty with its faults."""

import os
import time
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbot_agent.board import board_kinds
from mbot_agent.board.board_session import (
    BoardLostError,
    BoardResetError,
    BoardSession,
    UnacknowledgedError,
)
from mbot_agent.board.lines import line_session
from mbot_agent.board.lines.line_protocol import LONGEST_LINE, LineReader, drive_line, firmware
from mbot_agent.board.lines.line_session import STOP_ATTEMPTS, LineSession
from mbot_agent.board.motors import Motors
from mbot_agent.board.serial_line import SerialLine
from mbot_agent.configuration import BoardSettings
from mbot_protocol.drive.wheel_command import STOP, Duties, WheelCommand
from mbot_protocol.errors import UnreachableError

from ..until import until
from .line_board import NAME, LineBoard

FORWARD = Duties(-120 / 255, 80 / 255)
LINE = "D-120+080"
ON_ITS_WAY_S = 0.05


@pytest.fixture
def line_board() -> Iterator[LineBoard]:
    with LineBoard() as board:
        yield board


@pytest.fixture
def session(line_board: LineBoard) -> Iterator[LineSession]:
    with LineSession.open(BoardSettings(port=line_board.path), None) as opened:
        assert opened.handshake(never)
        opened.arm()
        line_board.lines.clear()
        yield opened


def never() -> bool:
    return False


@given(st.floats(-1, 1), st.floats(-1, 1))
def test_a_command_is_nine_characters_and_says_both_duties(left: float, right: float) -> None:
    line = drive_line(Duties(left, right))
    assert len(line) == 9
    assert abs(int(line[1:5]) / 255 - left) <= 0.5001 / 255
    assert abs(int(line[5:]) / 255 - right) <= 0.5001 / 255
    assert "-000" not in line


@given(st.lists(st.binary(max_size=200)))
def test_lines_are_the_same_however_the_bytes_come(pieces: list[bytes]) -> None:
    reader = LineReader()
    found = [line for piece in pieces for line in reader.feed(piece)]
    assert found == LineReader().feed(b"".join(pieces))
    assert all(0 < len(line) <= LONGEST_LINE for line in found)
    reader.feed(b"\n")
    assert reader.feed(b"ok\r\n") == ["ok"]


def test_what_never_ends_is_no_line_and_is_not_kept() -> None:
    reader, longest = LineReader(), b"x" * LONGEST_LINE
    assert reader.feed(longest + b"\n") == [longest.decode()]
    assert reader.feed(longest + b"x\n") == []
    assert reader.feed(longest + b"x") == reader.feed(b"\n") == []
    reader.feed(longest * 9)
    assert len(reader._begun) <= LONGEST_LINE + 1  # pyright: ignore[reportPrivateUsage]


@pytest.mark.parametrize(
    ("line", "deadman", "mistaken"),
    [
        (NAME, True, False),
        ("serial-line 1 1ms", True, False),
        ("serial-line 1 1000ms", True, False),
        ("serial-line 1 0ms", False, False),
        ("serial-line 1 1001ms", False, False),
        ("serial-line 2 300ms", True, True),
    ],
)
def test_a_board_says_what_it_is(line: str, deadman: bool, mistaken: bool) -> None:
    found = firmware(line)
    assert found is not None
    assert (found.version, found.has_deadman, found.may_latch) == (line, deadman, True)
    assert bool(found.mistaken) is mistaken


@given(st.text(max_size=40))
def test_nothing_else_is_a_board(text: str) -> None:
    assert firmware(f"x{text}") is None
    assert firmware(f"{NAME}{text}x") is None


def test_it_is_a_board_of_its_kind_stopped_before_and_after(line_board: LineBoard) -> None:
    settings = BoardSettings(kind="serial-line", port=line_board.path)
    session: BoardSession = board_kinds.opener(settings)(settings, None)
    with session:
        assert session.firmware.version == ""
        assert session.handshake(never)
        assert session.firmware.version == NAME
        assert line_board.lines == ["S", "V", "S"]
        session.arm()
        began_ns = time.monotonic_ns()
        written_ns, acknowledged_ns = session.send(FORWARD)
        assert began_ns <= written_ns < acknowledged_ns
        assert line_board.last == LINE
    assert line_board.last == "S"


def test_a_board_without_a_name_is_not_found_by_itself() -> None:
    with pytest.raises(UnreachableError, match=r"set board\.port; there is (nothing|/)"):
        LineSession.open(BoardSettings(kind="serial-line"), None)


def test_what_latches_is_armed_before_it_drives(line_board: LineBoard) -> None:
    with LineSession.open(BoardSettings(port=line_board.path), None) as session:
        assert session.handshake(never)
        session.send(STOP)
        with pytest.raises(UnacknowledgedError):
            session.send(FORWARD)
        session.arm()
        session.send(FORWARD)


def test_an_echo_that_differs_is_none(line_board: LineBoard, session: LineSession) -> None:
    """One of the two ways has garbled it."""
    line_board.garbled = "D-120+090"
    with pytest.raises(UnacknowledgedError):
        session.send(FORWARD)


def test_a_late_echo_is_not_taken_for_the_next_one(
    line_board: LineBoard, session: LineSession
) -> None:
    line_board.say(LINE)
    time.sleep(ON_ITS_WAY_S)
    line_board.mute = True
    with pytest.raises(UnacknowledgedError):
        session.send(FORWARD)


def test_a_torn_line_does_not_swallow_the_stop(line_board: LineBoard, session: LineSession) -> None:
    session.send(FORWARD)
    session._line.write(b"D-12")  # pyright: ignore[reportPrivateUsage]
    session.stop()
    assert line_board.lines == [LINE, "S"]


def test_a_stop_is_repeated_and_then_the_board_is_lost(
    line_board: LineBoard, session: LineSession
) -> None:
    line_board.garbled = "?"
    session.stop()
    assert line_board.lines == ["S", "S"]
    line_board.mute = True
    began_s = time.monotonic()
    with pytest.raises(BoardLostError, match="the stop") as lost:
        session.stop()
    assert not isinstance(lost.value, UnacknowledgedError)
    assert time.monotonic() - began_s >= STOP_ATTEMPTS * 0.05


def test_a_reset_is_told_whatever_is_being_done(
    line_board: LineBoard, session: LineSession
) -> None:
    for act in (lambda: session.wait(5.0), lambda: session.send(FORWARD), session.stop):
        line_board.reset()
        time.sleep(ON_ITS_WAY_S)
        with pytest.raises(BoardResetError, match=line_board.path):
            act()
    assert not line_board.lines


def test_a_port_without_such_a_board_is_given_up(
    line_board: LineBoard, monkeypatch: pytest.MonkeyPatch
) -> None:
    line_board.mute = True
    with LineSession.open(BoardSettings(port=line_board.path), None) as session:
        looks = iter([False, True, True])
        assert not session.handshake(lambda: next(looks))
        monkeypatch.setattr(line_session, "HANDSHAKE_TIMEOUT_S", 0.3)
        with pytest.raises(BoardLostError, match="at 115200 baud"):
            session.handshake(never)
        line_board.mute = False


def test_waiting_ends_with_a_wake_up(line_board: LineBoard) -> None:
    reader, writer = os.pipe()
    with LineSession.open(BoardSettings(port=line_board.path), reader) as session:
        assert session.handshake(never)
        os.write(writer, b"x")
        session.wait(60.0)
    os.close(reader)
    os.close(writer)


def test_a_lost_board_is_not_talked_to_and_its_port_is_given_back(line_board: LineBoard) -> None:
    settings = BoardSettings(port=line_board.path)
    session = LineSession(SerialLine(line_board.path, settings.baud_rate, None))
    session.__exit__(BoardLostError, BoardLostError("the cable is out"), None)
    with LineSession.open(settings, None):
        assert not line_board.lines
        line_board.mute = True  # a stop that nobody confirms hides nothing at the end


def test_the_motor_thread_drives_it(line_board: LineBoard) -> None:
    with Motors(BoardSettings(kind="serial-line", port=line_board.path)) as motors:
        assert until(lambda: motors.fault is None)
        motors.arm()
        motors.drive(WheelCommand(FORWARD, time.monotonic_ns() + 10**9))
        assert until(lambda: line_board.last == "D+120+080")
        assert until(lambda: line_board.last == "S", 3)
    assert line_board.stands
