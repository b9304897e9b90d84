"""The daemon's log: no thread ever waits for whoever reads it.

A line goes into a bounded queue, and a thread of its own writes it to stderr. When nobody takes the
lines (a full pipe, a stopped terminal) they are dropped and counted: STOP must not wait for a log.
"""

import contextlib
import logging
import logging.handlers
import os
import queue
import threading
from typing import Any, cast

STDERR = 2

BACKLOG = 1000
"""Lines; some 100 kB."""

LAST_WORDS_WAIT_S = 0.5
"""What the end of the process waits for the lines before it."""


class _Dropping(logging.handlers.QueueHandler):
    """Puts records into a queue, or drops them."""

    def __init__(self, backlog: "queue.Queue[logging.LogRecord | str]") -> None:
        super().__init__(cast(Any, backlog))
        self.dropped = 0
        self._backlog = backlog

    def enqueue(self, record: logging.LogRecord) -> None:
        try:
            self._backlog.put_nowait(record)
        except queue.Full:
            self.dropped += 1


class Journal:
    """Sends all logging to stderr, or another file descriptor, by way of the queue."""

    def __init__(self, *, verbose: bool, stream: int = STDERR) -> None:
        self._stream = stream
        # The journal stamps lines itself; a person at a terminal needs the time.
        dates = "" if "JOURNAL_STREAM" in os.environ else "%(asctime)s "
        self._formatter = logging.Formatter(f"{dates}%(levelname)s %(message)s")
        self._backlog: queue.Queue[logging.LogRecord | str] = queue.Queue(BACKLOG)
        self._handler = _Dropping(self._backlog)
        root = logging.getLogger()
        root.handlers[:] = [self._handler]
        root.setLevel(logging.DEBUG if verbose else logging.INFO)
        self._idle = threading.Condition()
        self._thread = threading.Thread(target=self._run, name="journal", daemon=True)
        self._thread.start()

    def say(self, line: str) -> None:
        """Write a line as it is, for a person; dropped as any other."""
        with contextlib.suppress(queue.Full):
            self._backlog.put_nowait(line)

    def drain(self, timeout_s: float = LAST_WORDS_WAIT_S) -> None:
        """Wait until all that was said is written, if somebody reads it."""
        with self._idle:
            self._idle.wait_for(lambda: self._backlog.unfinished_tasks == 0, timeout_s)

    def _run(self) -> None:
        told = 0
        while True:
            said = self._backlog.get()
            line = said if isinstance(said, str) else self._formatter.format(said)
            if (dropped := self._handler.dropped) > told:
                line = f"({dropped - told} lines were dropped here: nobody read them)\n{line}"
                told = dropped
            with contextlib.suppress(OSError):  # stderr is closed: nobody wants to know
                _write(self._stream, f"{line}\n".encode(errors="replace"))
            with self._idle:
                self._backlog.task_done()
                self._idle.notify_all()


def _write(stream: int, data: bytes) -> None:
    """Not by sys.stderr: its lock would be held for as long as nobody reads."""
    while data:
        data = data[os.write(stream, data) :]
