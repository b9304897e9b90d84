"""`Robot` and the real daemon, between a fake board and a camera: who may turn the wheels."""

import signal
import sys
import time
from pathlib import Path

import pytest

from mbot import RefusedError, Robot
from mbot_workstation.fleet.by_hand.timed_drive import HOLD_MS

from ..end_to_end.processes import Daemon, Process, beats_on
from ..robot.fake_board import FakeBoard
from ..robot.tiny_models import constant_model
from ..until import until

pytestmark = pytest.mark.slow

LATE_S = 0.3
"""Of a busy machine, and of what is on the wire."""

DRIVES = """
import time
from mbot import Robot
with Robot({address!r}) as robot:
    robot.drive(0.5, 0.5)
    time.sleep(60)
"""


def turns(board: FakeBoard) -> bool:
    return board.speeds != (0, 0)


def stays_at_rest(board: FakeBoard) -> bool:
    mark = len(board.commands)
    time.sleep(0.8)
    return all(speeds[1:] == (0, 0) for speeds in board.commands[mark:])


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGSTOP])
def test_a_program_that_is_gone_turns_no_wheels(
    daemon: Daemon, board: FakeBoard, tmp_path: Path, number: signal.Signals
) -> None:
    with daemon.camera(), daemon.start():
        assert daemon.is_up()
        text = DRIVES.format(address=daemon.address)
        with Process(sys.executable, "-c", text, log=tmp_path / "program.log") as program:
            assert until(lambda: turns(board), 20), program.output
            time.sleep(3 * HOLD_MS / 1000)
            assert turns(board)
            ended_s = time.monotonic()
            program.signal(number)
            assert until(lambda: not turns(board), 5)
            assert time.monotonic() - ended_s < HOLD_MS / 1000 + LATE_S
            assert stays_at_rest(board)
            if number is signal.SIGSTOP:  # what goes on after a while has let go
                program.signal(signal.SIGCONT)
                assert stays_at_rest(board)


def test_nobody_drives_over_somebody_elses_stop(daemon: Daemon, board: FakeBoard) -> None:
    with daemon.camera(), daemon.start():
        assert daemon.is_up()
        daemon.push(constant_model(0.6, 0.6))
        assert until(daemon.is_ready)
        with Robot(daemon.address) as mine, Robot(daemon.address) as theirs:
            mine.drive(0.5, 0.5)
            assert until(lambda: turns(board))
            theirs.stop()
            assert not turns(board)
            assert stays_at_rest(board)
            for act in (lambda: mine.drive(0.5, 0.5), mine.run):
                with pytest.raises(RefusedError, match=r"stopped by .* look with robot\.state"):
                    act()
            assert stays_at_rest(board)
            assert mine.state().last_stop.startswith("stopped by")
            mine.drive(0.5, 0.5, seconds=0.5)
            assert until(lambda: not turns(board), 1)
            theirs.run()
            assert until(lambda: turns(board))
            mine.drive(-0.3, -0.3)  # a hand goes before a policy, which does not go on by itself
        assert stays_at_rest(board)
        assert daemon.status().let_go_monotonic_ns


def test_a_policy_goes_on_after_the_block_and_no_block_begins_by_itself(
    daemon: Daemon, board: FakeBoard
) -> None:
    with daemon.camera(), daemon.start():
        assert daemon.is_up()
        daemon.push(constant_model(0.6, 0.6))
        assert until(daemon.is_ready)
        with Robot(daemon.address) as robot:
            assert next(robot.frames()).shape == (64, 64, 3)
            assert next(robot.beats()).state == "idle"
            assert beats_on(daemon.status)
            assert not board.moved
            robot.run()
        assert beats_on(daemon.status)
        assert turns(board)
        with Robot(daemon.address) as robot:
            robot.stop()
        assert not turns(board)
