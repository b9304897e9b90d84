"""What a fake board was told, looked at afterwards."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ..end_to_end.processes import Daemon, Process, until
from ..robot.fake_board import FakeBoard
from ..robot.tiny_models import constant_model

FORWARD = constant_model(0.6, 0.6)
FORWARD_BOARD = (-169, 169)


def stopped_s(board: FakeBoard, since_s: float) -> float:
    """When the first STOP came after the last command that turned a wheel, or after `since_s`."""
    driven_s = max((at for at, m1, m2 in board.commands if (m1, m2) != (0, 0)), default=0.0)
    return next(
        at for at, m1, m2 in board.commands if at >= max(since_s, driven_s) and (m1, m2) == (0, 0)
    )


def driven_since(board: FakeBoard, since_s: float) -> int:
    """Motor frames that turned a wheel, from a time on."""
    return sum(at >= since_s and (m1, m2) != (0, 0) for at, m1, m2 in board.commands)


def drives_again(daemon: Daemon, board: FakeBoard, speeds: tuple[int, int] = FORWARD_BOARD) -> bool:
    """Whether a person's word is all that it takes, once nothing is wrong any more."""
    if not until(lambda: not daemon.status().faults, 30):
        return False
    daemon.run()
    return board.wait_for(*speeds, timeout_s=15)


def configure(daemon: Daemon, section: str, lines: str) -> None:
    """Add settings to a section of the daemon's configuration."""
    text = daemon.config.read_text()
    assert f"[{section}]" in text
    daemon.config.write_text(text.replace(f"[{section}]", f"[{section}]\n{lines}"))


def script(daemon: Daemon, name: str) -> Process:
    """The real daemon, started by a script beside this file that changes one thing."""
    import sys

    program = str(Path(__file__).with_name(name))
    return Process(sys.executable, program, "--config", str(daemon.config), log=daemon.log)


@contextmanager
def driving(daemon: Daemon, board: FakeBoard, process: Process) -> Iterator[Process]:
    """A daemon that has a model and drives."""
    with process:
        assert daemon.is_up()
        daemon.push(FORWARD)
        daemon.run()
        assert board.wait_for(*FORWARD_BOARD, timeout_s=15)
        yield process
