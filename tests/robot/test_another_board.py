"""A board that speaks the mCore's protocol and is none: its motors turn otherwise than told."""

import time

import pytest

from mbot_agent.board.motors import Motors
from mbot_agent.configuration import Board
from mbot_agent.hardware import DriveCommand
from mbot_protocol.mcore import Joystick

from ..until import until
from .fake_board import FakeBoard


@pytest.mark.parametrize("version", ["09.01.001", "0e.01.018"])
def test_another_board_of_the_same_maker_is_never_driven(version: str) -> None:
    """Not even where no dead man's switch is asked for."""
    with (
        FakeBoard(version) as board,
        Motors(Board(port=board.path, accept_no_deadman=True)) as motors,
    ):
        assert until(lambda: motors.version == version)
        assert motors.fault is not None
        assert motors.fault.kind == "board-other"
        motors.drive(DriveCommand(Joystick(-100, 100), time.monotonic_ns() + 10**9))
        assert motors.stands(1.0), "but it is stopped as any other"
        assert not board.moved
