"""Taking turns without a word: nobody waits for a lock whose holder is busy with a log."""

import logging
import threading
from typing import Self

log = logging.getLogger(__name__)


class Turn:
    """A lock, as a context manager. What its holder says is logged when the turn is over."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._holder: int | None = None
        self._said: list[tuple[int, str, tuple[object, ...]]] = []

    def __enter__(self) -> Self:
        self._lock.acquire()
        self._holder = threading.get_ident()
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        said, self._said, self._holder = self._said, [], None
        self._lock.release()
        for level, line, values in said:
            log.log(level, line, *values)

    def taken_within(self, timeout_s: float) -> bool:
        """Take the turn for good, at the very end, if it comes in time."""
        return self._lock.acquire(timeout=timeout_s)

    def say(self, level: int, line: str, *values: object) -> None:
        """Log a line: now, or after this thread's turn."""
        if self._holder == threading.get_ident():
            self._said.append((level, line, values))
        else:
            log.log(level, line, *values)
