"""The daemon's motor thread drives the compiled firmware, in real time over a pseudo-terminal."""

import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from mbot_agent.board.motor_stop import stop_motors
from mbot_agent.board.motors import Motors
from mbot_agent.configuration import BoardSettings
from mbot_protocol.drive.mcore import ARM_REQUEST, Joystick, stop_burst
from mbot_protocol.drive.wheel_command import WheelCommand

from ..promised import promised
from ..until import until
from .frames import DRIVE, DRIVING, OFF
from .simulated_board import BYTE_US, LiveBoard, Simulator

TIMEOUT_MS = 300
"""Of the firmware, without a word from its host."""


@pytest.fixture
def board(simulator: Simulator) -> Iterator[LiveBoard]:
    with LiveBoard(simulator) as live:
        yield live


@contextmanager
def driving_process(board: LiveBoard) -> Iterator["subprocess.Popen[bytes]"]:
    program = Path(__file__).with_name("driving_process.py")
    child = subprocess.Popen([sys.executable, program, board.port])
    try:
        assert board.wait_for(*DRIVING)
        yield child
    finally:
        child.kill()
        child.wait()


def for_s(seconds: float) -> WheelCommand:
    return WheelCommand(Joystick(*DRIVING).duties, time.monotonic_ns() + int(seconds * 1e9))


def silence_ms(board: LiveBoard) -> float:
    """Simulated time between the last byte the board got and its motors being off."""
    last_us = max(at for at, _ in board.trace.received if at < board.trace.stopped_us())
    return (board.trace.stopped_us() - last_us - BYTE_US) / 1000


def test_the_daemon_trusts_it_and_drives(board: LiveBoard) -> None:
    with Motors(BoardSettings(port=board.port)) as motors:
        assert until(lambda: motors.fault is None)
        assert motors.version == "mbot-deadman 3 300ms"
        assert motors.has_deadman
        motors.arm()
        assert motors.delivery(motors.drive(for_s(10)), 1.0) is not None
        assert board.wait_for(*DRIVING)
        motors.drive(for_s(0.2))  # and no word after that
        assert board.wait_for(*OFF)
        assert motors.fault is None
        assert motors.delivery(motors.drive(for_s(10)), 1.0) is not None
        assert board.wait_for(*DRIVING)
    assert board.wait_for(*OFF)


def test_a_killed_daemon_stops_in_time_and_another_takes_over(board: LiveBoard) -> None:
    with driving_process(board) as child:
        child.kill()
        assert board.wait_for(*OFF)
        assert TIMEOUT_MS - 1 <= silence_ms(board) <= promised("deadman-stopped")
    with Motors(BoardSettings(port=board.port)) as motors:
        assert until(lambda: motors.fault is None)
        motors.arm()
        motors.drive(for_s(10))
        assert board.wait_for(*DRIVING)


def test_a_frozen_daemon_stops_in_time_and_stays_stopped(board: LiveBoard) -> None:
    with driving_process(board) as child:
        child.send_signal(signal.SIGSTOP)
        assert board.wait_for(*OFF)
        assert TIMEOUT_MS - 1 <= silence_ms(board) <= promised("deadman-stopped")
        heard = len(board.trace.received)
        child.send_signal(signal.SIGCONT)

        # Its next commands are refused, whatever stops it sends: nobody has said `run` since.
        def heard_since() -> bytes:
            return bytes(byte for _, byte in board.trace.received[heard:])

        assert until(lambda: heard_since().count(DRIVE) >= 5)
        assert stop_burst() in heard_since()
        assert ARM_REQUEST not in heard_since()
        assert board.trace.speeds_since(board.trace.stopped_us() / 1000 + 1) <= {OFF}


def drive_again_and_again(motors: Motors) -> None:
    """As the loop does, decision by decision, until the board is known to have latched."""

    def latched() -> bool:
        motors.delivery(motors.drive(for_s(1)), 0.2)
        return motors.resets > 0

    assert until(latched)


def test_the_loop_learns_of_a_board_that_has_latched(board: LiveBoard) -> None:
    with Motors(BoardSettings(port=board.port)) as motors:
        assert until(lambda: motors.fault is None)
        drive_again_and_again(motors)  # not armed
        assert motors.resets == 1
        assert motors.fault is None
        motors.arm()
        motors.drive(for_s(10))
        assert board.wait_for(*DRIVING)


def test_arm_is_not_said_for_somebody_who_has_changed_his_mind(board: LiveBoard) -> None:
    with Motors(BoardSettings(port=board.port)) as motors:
        assert until(lambda: motors.fault is None)
        motors.arm()
        motors.disarm()
        drive_again_and_again(motors)
        assert motors.resets == 1
        assert ARM_REQUEST not in bytes(byte for _, byte in board.trace.received)


def test_the_stop_command_after_a_crash_is_confirmed(board: LiveBoard) -> None:
    with driving_process(board) as child:
        child.kill()
        child.wait()
        stop_motors(BoardSettings(port=board.port))
        assert board.wait_for(*OFF)
