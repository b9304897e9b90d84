"""`mbot-agent stop-motors` on a pseudo-terminal: whatever the port does, once within its time."""

import logging
import os
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest

from mbot_agent.board import motor_stop
from mbot_agent.board.mcore import mcore_session
from mbot_agent.board.motor_stop import PAUSE_S, stop_motors
from mbot_agent.configuration import Board
from mbot_protocol.errors import UnreachableError

from ..until import until
from .fake_board import FakeBoard


@pytest.fixture(autouse=True)
def brisk(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(motor_stop, "TIME_LIMIT_S", 1.5)


def clock(sleep: Callable[[float], None]) -> SimpleNamespace:
    return SimpleNamespace(monotonic=time.monotonic, sleep=sleep)


def descriptors() -> set[str]:
    return {path.name for path in Path("/proc/self/fd").iterdir()}


def test_a_board_that_drives_is_stopped_and_says_so(
    board: FakeBoard, caplog: pytest.LogCaptureFixture
) -> None:
    kept = descriptors()
    with caplog.at_level(logging.INFO):
        stop_motors(Board(port=board.path))
    assert board.speeds == (0, 0)
    assert len(board.commands) >= mcore_session.STOP_REPEATS
    assert f"motors stopped ({board.path}, {board.version})" in caplog.text
    assert descriptors() <= kept


def test_a_port_that_comes_back_is_waited_for(
    tmp_path: Path, board: FakeBoard, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As one that the daemon's ghost holds still, or that is plugged in again."""
    link = tmp_path / "board"
    began_s = time.monotonic()

    def plug_in(seconds: float) -> None:
        assert seconds == PAUSE_S
        os.symlink(board.path, link)  # noqa: PTH211

    monkeypatch.setattr(motor_stop, "time", clock(plug_in))
    stop_motors(Board(port=str(link)))
    assert len(board.commands) >= mcore_session.STOP_REPEATS
    assert time.monotonic() - began_s < 1.0


def test_a_board_that_says_nothing_is_asked_until_the_time_is_over(board: FakeBoard) -> None:
    board.mute = True
    kept = descriptors()
    began_s = time.monotonic()
    with pytest.raises(UnreachableError, match=board.path):
        stop_motors(Board(port=board.path))
    assert 1.0 < time.monotonic() - began_s < 2.5
    assert descriptors() <= kept


def test_a_port_that_is_not_there_is_looked_for_until_the_time_is_over() -> None:
    began_s = time.monotonic()
    busy_s = time.process_time()
    with pytest.raises(UnreachableError, match="/dev/there-is-none"):
        stop_motors(Board(port="/dev/there-is-none"))
    assert 1.5 - PAUSE_S <= time.monotonic() - began_s < 1.5 + PAUSE_S
    assert time.process_time() - busy_s < 0.5


def test_a_board_that_answers_late_is_stopped(
    board: FakeBoard, monkeypatch: pytest.MonkeyPatch
) -> None:
    board.mute = True
    pauses: list[float] = []

    def speak(seconds: float) -> None:
        pauses.append(seconds)
        board.mute = False

    monkeypatch.setattr(mcore_session, "HANDSHAKE_TIMEOUT_S", 0.3)
    monkeypatch.setattr(motor_stop, "time", clock(speak))
    stop_motors(Board(port=board.path))
    assert pauses == [PAUSE_S]
    assert until(lambda: len(board.commands) >= mcore_session.STOP_REPEATS)


def test_a_kind_that_nobody_knows_keeps_nobody_from_stopping(board: FakeBoard) -> None:
    stop_motors(Board(kind="nocore", port=board.path))
    assert len(board.commands) >= mcore_session.STOP_REPEATS
