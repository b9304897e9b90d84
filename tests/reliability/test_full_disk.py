"""Row of the fault table: disk full, EIO. The real daemon, on a disk that keeps nothing."""

import signal
import sys
from collections.abc import Callable

import pytest

from mbot_protocol.errors import RefusedError

from ..end_to_end.processes import PROGRAMS, Daemon, Process, until
from ..promised import promised
from ..robot.fake_board import FakeBoard
from ..robot.tiny_models import constant_model
from .motion import FORWARD, FORWARD_BOARD, driving

SECOND = constant_model(0.2, 0.2, name="second")

Record = Callable[[str, object], None]


def on_a_bad_disk(daemon: Daemon, error: str) -> Process:
    """No file that the daemon means to keep reaches the disk. strace steps aside: -D."""
    command = ["strace", "-D", "-f", "-qq", "--seccomp-bpf", "-o", str(daemon.directory / "trace")]
    command += ["-e", "trace=fsync", "-e", f"inject=fsync:error={error}"]
    program = [sys.executable, PROGRAMS.format("mbot-agent"), "run", "--config", str(daemon.config)]
    return Process(*command, *program, log=daemon.log)


@pytest.mark.parametrize(
    ("error", "words"), [("ENOSPC", "No space left"), ("EIO", "Input/output error")]
)
def test_a_disk_that_takes_nothing_keeps_the_old_model_and_the_robot_driving(
    daemon: Daemon, board: FakeBoard, error: str, words: str, record_property: Record
) -> None:
    def end(process: Process) -> None:
        process.signal(signal.SIGTERM)
        process.wait()
        daemon.log.write_text("")

    with daemon.camera():
        with driving(daemon, board, daemon.start()) as process:
            end(process)
        with on_a_bad_disk(daemon, error) as process:
            assert daemon.is_up()
            daemon.run()
            assert board.wait_for(*FORWARD_BOARD, timeout_s=15)
            with pytest.raises(RefusedError, match=words):
                daemon.push(SECOND)
            assert daemon.status().active_model.name == "constant"
            decisions = daemon.status().decisions
            assert until(lambda: daemon.status().decisions > decisions + 2)
            assert board.wait_for(*FORWARD_BOARD)
            end(process)
        with daemon.start():
            assert daemon.is_up()
            loaded = daemon.status().active_model
            daemon.push(SECOND)  # there is room again
            assert daemon.status().active_model.name != "constant"
    loads_percent = 100 * (loaded.name == "constant")
    record_property("old model loads %", loads_percent)
    assert loads_percent == promised("full-disk-loads")
    assert loaded.size_bytes == len(FORWARD)
