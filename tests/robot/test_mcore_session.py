"""One connection to the board, without the motor thread: what is on the wire, and in what order."""

import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress

import pytest

from mbot_agent.board.board_session import BoardLostError, BoardResetError, UnacknowledgedError
from mbot_agent.board.mcore import mcore_session
from mbot_agent.board.mcore.mcore_session import STOP_ATTEMPTS, STOP_REPEATS, McoreSession
from mbot_agent.configuration import Board
from mbot_protocol.drive.actions import AS_BUILT
from mbot_protocol.drive.mcore import (
    ARM_REQUEST,
    END,
    HEADER,
    VERSION_REQUEST,
    Joystick,
    stop_burst,
)

from .fake_board import FakeBoard

FORWARD = AS_BUILT.at_motors(Joystick(-100, 100).duties)
ACKNOWLEDGEMENT = HEADER + END
BANNER = b"Version: 06.01.107\r\n"
ON_ITS_WAY_S = 0.02
"""What a board has said is in the port's buffer by then: a pty has no wire."""


@pytest.fixture
def wake() -> Iterator[tuple[int, int]]:
    reader, writer = os.pipe()
    yield reader, writer
    os.close(reader)
    os.close(writer)


@pytest.fixture
def session(board: FakeBoard, wake: tuple[int, int]) -> Iterator[McoreSession]:
    """Open, and nothing has been said yet."""
    with McoreSession.open(Board(port=board.path), wake[0]) as opened:
        yield opened


def never() -> bool:
    return False


def took_s(act: Callable[[], object]) -> float:
    began_s = time.monotonic()
    act()
    return time.monotonic() - began_s


def test_a_handshake_stops_the_board_before_and_after_it_is_known(
    board: FakeBoard, session: McoreSession
) -> None:
    assert session.firmware.version == ""
    assert session.handshake(never)
    assert session.firmware.version == "06.01.107"
    assert bytes(board.received) == stop_burst() + VERSION_REQUEST + STOP_REPEATS * stop_burst()


def test_a_board_that_boots_is_asked_again(board: FakeBoard, session: McoreSession) -> None:
    board.mute = True
    waking = threading.Timer(0.5, setattr, (board, "mute", False))
    waking.start()
    assert session.handshake(never)
    asked = bytes(board.received).count(VERSION_REQUEST)
    assert 2 <= asked <= 6, "each 0.2 s, for what is sent during the boot is lost"


def test_a_handshake_ends_when_it_is_given_up(board: FakeBoard, session: McoreSession) -> None:
    board.mute = True
    looks = iter([False, True, True])
    began_s = time.monotonic()
    assert not session.handshake(lambda: next(looks))
    assert time.monotonic() - began_s < 3.0
    assert session.firmware.version == ""


def test_a_port_without_a_board_is_given_up_after_a_while(
    board: FakeBoard, session: McoreSession, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mcore_session, "HANDSHAKE_TIMEOUT_S", 0.5)
    board.mute = True
    with pytest.raises(BoardLostError, match="at 115200 baud") as lost:
        session.handshake(never)
    assert board.path in str(lost.value)


def test_whatever_ends_a_session_stops_the_motors_and_gives_the_port_back(
    board: FakeBoard, wake: tuple[int, int]
) -> None:
    for error in (None, ValueError("anything")):
        try:
            with McoreSession.open(Board(port=board.path), wake[0]) as session:
                session.send(FORWARD)
                assert board.speeds == (-100, 100)
                if error is not None:
                    raise error
        except ValueError:
            pass
        assert board.speeds == (0, 0)


def test_a_lost_board_is_not_talked_to_and_its_port_is_given_back(
    board: FakeBoard, wake: tuple[int, int]
) -> None:
    session = McoreSession.open(Board(port=board.path), wake[0])
    session.send(FORWARD)
    mark = len(board.received)
    session.__exit__(BoardLostError, BoardLostError("the cable is out"), None)
    with McoreSession.open(Board(port=board.path), wake[0]):
        assert bytes(board.received[mark:]) == b""
        board.acknowledge = False  # a stop that nobody confirms hides nothing at the end


def test_a_command_comes_back_with_its_times(board: FakeBoard, session: McoreSession) -> None:
    began_ns = time.monotonic_ns()
    written_ns, acknowledged_ns = session.send(FORWARD)
    assert began_ns <= written_ns < acknowledged_ns <= time.monotonic_ns()
    assert board.speeds == (-100, 100)


def test_a_command_that_is_not_acknowledged_is_called_so_soon(
    board: FakeBoard, session: McoreSession
) -> None:
    board.acknowledge = False
    began_s = time.monotonic()
    with pytest.raises(UnacknowledgedError, match=board.path):
        session.send(FORWARD)
    assert 0.045 <= time.monotonic() - began_s < 1.0


def test_an_old_acknowledgement_is_not_taken_for_the_next_one(
    board: FakeBoard, session: McoreSession
) -> None:
    """It came too late for its own command."""
    board.acknowledge = False
    board.say(ACKNOWLEDGEMENT)
    time.sleep(ON_ITS_WAY_S)
    with pytest.raises(UnacknowledgedError):
        session.send(FORWARD)


def test_a_board_that_has_been_reset_gets_no_command(
    board: FakeBoard, session: McoreSession
) -> None:
    board.say(BANNER)
    time.sleep(ON_ITS_WAY_S)
    with pytest.raises(BoardResetError, match=board.path):
        session.send(FORWARD)
    time.sleep(ON_ITS_WAY_S)
    assert not board.received
    session.send(FORWARD)  # told once


def test_a_reset_behind_an_acknowledgement_counts(board: FakeBoard, session: McoreSession) -> None:
    board.behind_a_reply = BANNER
    with pytest.raises(BoardResetError, match=board.path):
        session.send(FORWARD)


def test_a_stop_is_two_acknowledged_bursts(board: FakeBoard, session: McoreSession) -> None:
    session.stop()
    assert bytes(board.received) == STOP_REPEATS * stop_burst()


def test_a_stop_is_repeated_until_the_board_hears_it(
    board: FakeBoard, session: McoreSession
) -> None:
    board.unheard = STOP_ATTEMPTS - STOP_REPEATS
    session.stop()
    assert bytes(board.received) == STOP_ATTEMPTS * stop_burst()
    board.unheard = STOP_ATTEMPTS - STOP_REPEATS + 1  # one acknowledgement proves nothing
    with pytest.raises(BoardLostError, match="does not acknowledge the stop") as lost:
        session.stop()
    assert not isinstance(lost.value, UnacknowledgedError)
    assert bytes(board.received) == 2 * STOP_ATTEMPTS * stop_burst()


def test_only_firmware_that_latches_is_armed(wake: tuple[int, int]) -> None:
    for version, latches in (("mbot-deadman 2 300ms", True), ("mbot-deadman 1", False)):
        with (
            FakeBoard(version) as board,
            McoreSession.open(Board(port=board.path), wake[0]) as session,
        ):
            assert session.handshake(never)
            assert session.firmware.may_latch is latches
            if latches:
                with pytest.raises(UnacknowledgedError):
                    session.send(FORWARD)
            session.arm()
            session.send(FORWARD)
            assert board.speeds == (-100, 100)
            assert bytes(board.received).count(ARM_REQUEST) == latches


def test_waiting_ends_with_its_time_a_wake_up_or_news(
    board: FakeBoard, session: McoreSession, wake: tuple[int, int]
) -> None:
    assert 0.09 < took_s(lambda: session.wait(0.1)) < 2.0
    assert took_s(lambda: session.wait(-1.0)) < 2.0
    os.write(wake[1], b"x")
    assert took_s(lambda: session.wait(10.0)) < 2.0
    os.read(wake[0], 1)
    board.say(ACKNOWLEDGEMENT)
    assert took_s(lambda: session.wait(10.0)) < 2.0
    board.say(BANNER)
    with pytest.raises(BoardResetError, match=r"has been reset \(06\.01\.107\)"):
        session.wait(10.0)


def test_nobody_wakes_a_command_that_waits_for_its_acknowledgement(
    board: FakeBoard, session: McoreSession, wake: tuple[int, int]
) -> None:
    """Else whoever wants something meanwhile would be spun for."""
    looks = 0
    read = session._read  # pyright: ignore[reportPrivateUsage]

    def counted(timeout_s: float, *, wakeable: bool = False) -> object:
        nonlocal looks
        looks += 1
        return read(timeout_s, wakeable=wakeable)

    session._read = counted  # pyright: ignore
    os.write(wake[1], b"x")
    board.acknowledge = False
    with pytest.raises(UnacknowledgedError):
        session.send(FORWARD)
    assert looks <= 4


def test_a_cable_that_is_pulled_is_named(wake: tuple[int, int]) -> None:
    for act in (lambda one: one.send(FORWARD), lambda one: one.wait(5.0)):
        with FakeBoard() as board:
            session = McoreSession.open(Board(port=board.path), wake[0])
            assert session.handshake(never)
            board.unplug()
            with pytest.raises(BoardLostError, match=board.path) as lost:
                act(session)
            assert not isinstance(lost.value, UnacknowledgedError)
            session.__exit__(BoardLostError, lost.value, None)


def test_a_port_that_takes_nothing_any_more_is_named(wake: tuple[int, int]) -> None:
    board = FakeBoard()  # which reads nothing: it was never plugged in
    session = McoreSession.open(Board(port=board.path), wake[0])
    fd = session._line._fd  # pyright: ignore[reportPrivateUsage]
    with suppress(BlockingIOError):
        while True:
            os.write(fd, bytes(1024))
    with pytest.raises(BoardLostError, match=f"writing to {board.path} failed"):
        session.send(FORWARD)
    session.__exit__(BoardLostError, BoardLostError("as it was"), None)
    with board:
        pass


def test_a_port_that_fails_is_named(board: FakeBoard, wake: tuple[int, int]) -> None:
    session = McoreSession.open(Board(port=board.path), wake[0])
    session._line.close()  # pyright: ignore[reportPrivateUsage]
    with pytest.raises(BoardLostError, match=f"reading from {board.path} failed"):
        session.wait(5.0)
