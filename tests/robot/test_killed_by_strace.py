"""Rows of the fault table: power cut during activation; disk full, EIO. On real system calls.

A real SIGKILL at each write, fsync, rename and unlink of a push and a roll-back, and the real error
in place of each fsync and write. A kill at an open needs no test of its own: before it is after the
call before, and the empty file it makes is what the kill at the first write leaves.
"""

import json
import sys
from pathlib import Path

import pytest

from mbot_agent.models.model_directory import ModelDirectory
from mbot_agent.models.sequence_floors import SequenceFloors

from ..ran import ran
from . import crash_process
from .crash_process import KEY, NEW, OLD, digest, prepare

POINTS = {"write": 8, "fsync": 14, "rename": 8, "unlink": 4}
"""More than there are, so that the last child gets through."""

WHEN = 60
"""Above what the parent itself does of these while it starts (with -B, 2 were counted)."""


def run(root: Path, call: str, injection: str) -> list[str]:
    """How each child ended."""
    points = POINTS[call]
    for point in range(1, points + 1):
        prepare(root / str(point))
    inject = ["-e", f"trace={call}", "-e", f"inject={call}:{injection}:when={WHEN}"]
    command = ["strace", "-f", "-qq", "-o", str(root / "trace"), *inject]
    program = [
        sys.executable,
        "-B",
        crash_process.__file__,
        str(root),
        call,
        str(WHEN),
        str(points),
    ]
    done = ran(*command, *program)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def active(directory: Path) -> bytes:
    """The model a start would load, whole and none but it, with the right floor."""
    store = ModelDirectory(directory, keep=2)
    store.sweep()
    data = store.read(store.activation.active)
    floor = SequenceFloors(directory).of(KEY)
    assert floor in ((200,) if data == NEW else (100, 200))
    assert not list(directory.glob("*.tmp"))
    return data


@pytest.mark.parametrize("call", POINTS)
def test_killed_at_any_call_the_old_model_or_the_new_one_loads_whole(
    tmp_path: Path, call: str
) -> None:
    ends = run(tmp_path, call, "signal=KILL")
    hit = ends.index("done")
    assert ends == ["killed"] * hit + ["done"] * (len(ends) - hit)
    assert hit > 0
    found = [active(tmp_path / str(point)) for point in range(1, len(ends) + 1)]
    assert set(found[:hit]) <= {OLD, NEW}
    assert set(found[hit:]) == {OLD}


@pytest.mark.parametrize(("call", "error"), [("fsync", "EIO"), ("write", "ENOSPC")])
def test_a_disk_that_refuses_at_any_call_keeps_the_old_model(
    tmp_path: Path, call: str, error: str
) -> None:
    ends = run(tmp_path, call, f"error={error}")
    hit = ends.index("done")
    assert ends == ["refused"] * hit + ["done"] * (len(ends) - hit)
    assert hit > 0
    for point, end in enumerate(ends, 1):
        store = ModelDirectory(tmp_path / str(point), keep=2)
        # Up to the activation the old one stays. What fails later is the note of a start or of the
        # roll-back: then it is the new one, which the push has reported as active.
        pushed = digest(NEW) in {model.sha256 for model in store.models()}
        assert active(tmp_path / str(point)) in ((OLD, NEW) if pushed else (OLD,)), (point, end)
