"""Children that push and go back, to be killed or failed by strace at one of their system calls.

    strace -f -e inject=CALL:signal=KILL:when=WHEN python crash_process.py ROOT CALL WHEN POINTS

strace counts each process's calls for itself. So child i makes WHEN - i such calls that do nothing,
and then its i-th real one is the one that is hit: one strace serves all points, each with a store
of its own below ROOT. Prints a JSON list: "killed", "refused" or "done" for each child.
"""

import contextlib
import hashlib
import json
import os
import sys
from collections.abc import Callable
from pathlib import Path

from mbot_agent.models.model_directory import Label, ModelDirectory
from mbot_agent.models.sequence_floors import SequenceFloors
from mbot_protocol.errors import RefusedError

OLDER, OLD, NEW = b"older model", b"old model", b"new model"
KEY = bytes(32)
REFUSED = 3

NOTHING: dict[str, Callable[[], object]] = {
    "write": lambda: os.write(9999, b""),
    "fsync": lambda: os.fsync(9999),
    "rename": lambda: os.rename("/nowhere/at/all", "/nowhere/else"),  # noqa: PTH104
    "unlink": lambda: os.unlink("/nowhere/at/all"),  # noqa: PTH108
}


def digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def prepare(directory: Path) -> None:
    """A store with a proven model."""
    store = ModelDirectory(directory, keep=2)
    for data in (OLDER, OLD):
        store.add(digest(data), data, Label(data.decode()))
        store.activate(digest(data), store.activation.active)
    store.change(lambda a: a.proved(digest(OLD)))
    SequenceFloors(directory).reach(KEY, 100)


def push_and_go_back(directory: Path) -> None:
    """What a push, a start and a roll-back do to the disk; the oldest model is deleted."""
    store = ModelDirectory(directory, keep=2)
    floors = SequenceFloors(directory)
    store.sweep()
    store.add(digest(NEW), NEW, Label("new", signed="a manifest"))
    floors.reach(KEY, 200)
    store.activate(digest(NEW), digest(OLD))
    store.change(lambda a: a.started(digest(NEW), 0.0))
    store.change(lambda a: a.rolled_back(digest(NEW), digest(OLD), "nonsense"))


def _child(directory: Path, call: str, nothings: int) -> None:
    for _ in range(nothings):
        with contextlib.suppress(OSError):
            NOTHING[call]()
    try:
        push_and_go_back(directory)
    except RefusedError:
        os._exit(REFUSED)
    os._exit(0)


def _main(root: Path, call: str, when: int, points: int) -> None:
    found: list[str] = []
    for point in range(1, points + 1):
        if (pid := os.fork()) == 0:
            _child(root / str(point), call, when - point)
        _, status = os.waitpid(pid, 0)
        ended = {0: "done", REFUSED: "refused"}
        found.append("killed" if os.WIFSIGNALED(status) else ended[os.WEXITSTATUS(status)])
    print(json.dumps(found))


if __name__ == "__main__":
    _main(Path(sys.argv[1]), sys.argv[2], int(sys.argv[3]), int(sys.argv[4]))
