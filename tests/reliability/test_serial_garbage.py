"""Row of the fault table: serial garbage. Whatever the board says, a stop stops it.

The real motor thread on a pseudo-terminal; a thousand pieces of garbage in every run of the tests,
100,000 by `make reliability` and `make fuzz`.
"""

import random
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import pytest

from mbot_agent.board.motors import Motors
from mbot_agent.configuration import BoardSettings
from mbot_protocol.drive.mcore import Joystick
from mbot_protocol.drive.wheel_command import WheelCommand

from ..end_to_end.processes import until
from ..promised import promised
from ..robot.fake_board import FakeBoard
from .effort import GARBAGE_CASES

FULL_SPEED = Joystick(-255, 255)
PIECES = (
    b"\xff\x55",
    b"\xff\x55\r\n",
    b"\xff\x55\x00\x04\x20",
    b"\xff\x55\x80\x01\x01\r\n",
    b"Version: ",
    b"Version: 06.01.107\r\n",
    b"\r\n",
    b"\xff\x55\x07\x00\x02\x05",
)

Record = Callable[[str, object], None]


def garbage(chance: random.Random) -> bytes:
    """Noise with pieces of the protocol in it, whole banners and acknowledgements among them."""
    parts = [
        chance.choice(PIECES) if chance.random() < 0.3 else chance.randbytes(chance.randrange(20))
        for _ in range(chance.randrange(1, 6))
    ]
    return b"".join(parts)


def turns(board: FakeBoard) -> bool:
    """Whether the board comes to full speed; what is said before that proves nothing."""
    deadline_s = time.monotonic() + 0.2
    while time.monotonic() < deadline_s:
        if board.speeds == (FULL_SPEED.m1, FULL_SPEED.m2):
            return True
        time.sleep(0.0002)
    return False


def comes_to_rest(motors: Motors, board: FakeBoard) -> bool:
    deadline_s = time.monotonic() + 5
    while not (motors.wait_stopped(0.0) and board.speeds == (0, 0)):
        if time.monotonic() > deadline_s:
            return False
        time.sleep(0.0002)
    return True


AT_ONCE = 8
"""Boards under attack at a time: most of a case is waiting for a reply that was swallowed."""


def attack(seed: int, cases: int) -> tuple[int, int]:
    """Garbage against one board: in how many cases it was turning, and did not come to rest."""
    chance = random.Random(seed)
    turning = not_stopped = 0
    with (
        FakeBoard() as board,
        Motors(BoardSettings(port=board.path, accept_no_deadman=True)) as motors,
    ):
        for _ in range(cases):
            assert until(lambda: motors.fault is None)  # some garbage is a reset's announcement
            motors.drive(WheelCommand(FULL_SPEED.duties, time.monotonic_ns() + 10**10))
            turning += turns(board)
            board.say(garbage(chance))
            if chance.random() < 0.5:
                time.sleep(0)  # sometimes it arrives before the stop is asked for
            motors.stop()
            # Stopped by the daemon, and the thread at rest: then nothing else can come.
            not_stopped += not comes_to_rest(motors, board)
            if len(board.commands) > 10_000:
                del board.commands[:-1]
                board.received.clear()
        assert until(lambda: motors.fault is None)
        assert board.speeds == (0, 0)
    return turning, not_stopped


@pytest.mark.timeout(300 + 0.07 * GARBAGE_CASES)
def test_garbage_from_the_board_ends_stopped(record_property: Record) -> None:
    """A case counts only if the wheels were turning at full speed when the garbage came."""
    cases = GARBAGE_CASES // AT_ONCE
    with ThreadPoolExecutor(AT_ONCE) as boards:
        found = list(boards.map(lambda seed: attack(seed, cases), range(AT_ONCE)))
    turning, not_stopped = (sum(column) for column in zip(*found, strict=True))
    share_percent = 100 * turning / (cases * AT_ONCE)
    record_property("at full speed %", round(share_percent, 1))
    record_property("not stopped", not_stopped)
    assert share_percent >= promised("garbage-full-speed"), (
        "the others prove nothing: their wheels stood anyway"
    )
    assert not_stopped == promised("garbage-not-stopped")
