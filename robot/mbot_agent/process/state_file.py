"""Tells root's updater, by a file in memory, whether the wheels may turn and what is in the way."""

import logging
import os
import queue
import threading
import time
from pathlib import Path
from typing import Self

from mbot_protocol.daemon_state import FILE, DaemonState
from mbot_protocol.files import atomic_file

log = logging.getLogger(__name__)

END_WAIT_S = 1.0


class StateFile:
    """Written at each change, by a thread of its own: the loop touches no file. A context manager.

    Outside systemd, which makes $RUNTIME_DIRECTORY, there is nobody to tell and nothing is written.
    """

    def __init__(self) -> None:
        where = os.environ.get("RUNTIME_DIRECTORY", "")
        self._path = Path(where) / FILE if where else None
        self._told: tuple[bool, tuple[str, ...]] | None = None
        self._changes: queue.SimpleQueue[DaemonState | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="state file", daemon=True)

    def __enter__(self) -> Self:
        if self._path is not None:
            self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._path is not None:
            self._changes.put(None)
            self._thread.join(END_WAIT_S)

    def tell(self, *, armed: bool, faults: tuple[str, ...]) -> None:
        """What holds now; returns at once."""
        if self._path is not None and (armed, faults) != self._told:
            self._told = armed, faults
            self._changes.put(DaemonState(armed, faults, os.getpid(), time.monotonic_ns()))

    def _run(self) -> None:
        assert self._path is not None
        while (state := self._changes.get()) is not None:
            try:
                atomic_file.replace(self._path, state.to_bytes())
            except OSError as error:
                log.warning("cannot tell the updater of a change: %s", error)
                atomic_file.remove(self._path)  # what no longer holds is worse than nothing
        atomic_file.remove(self._path)
