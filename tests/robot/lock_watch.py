"""Notices log calls that are made while one of the daemon's locks is held by the same thread."""

import logging
import sys
import threading
from types import ModuleType
from typing import Any

HELD = threading.local()
SPIED = ("Lock", "Condition")


class SpiedLock:
    """A lock or condition that knows how many this thread holds."""

    def __init__(self, real: Any) -> None:
        self._real = real

    def __enter__(self) -> Any:
        found = self._real.__enter__()
        HELD.depth = getattr(HELD, "depth", 0) + 1
        return found

    def __exit__(self, *how: Any) -> Any:
        HELD.depth -= 1
        return self._real.__exit__(*how)

    def acquire(self, *, timeout: float | None = None) -> bool:
        if timeout is not None:  # at the daemon's end, for good: nobody waits for that any more
            return self._real.acquire(timeout=timeout)
        HELD.depth = getattr(HELD, "depth", 0) + 1
        return self._real.acquire()

    def release(self) -> None:
        HELD.depth -= 1
        self._real.release()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._real, name)


class SpiedThreading(ModuleType):
    """`threading`, but for its locks."""

    def __init__(self) -> None:
        super().__init__("threading")

    def __getattr__(self, name: str) -> Any:
        real = getattr(threading, name)
        return (lambda *a: SpiedLock(real(*a))) if name in SPIED else real


class LockWatch(logging.Handler):
    """Takes every line of the daemon's log. Locks made since `watched_modules` count.

    Attributes:
        under_a_lock: the lines that were said while a lock was held.

    """

    def __init__(self) -> None:
        super().__init__()
        self.under_a_lock: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        if getattr(HELD, "depth", 0):
            self.under_a_lock.append(f"{record.module}:{record.lineno} {record.getMessage()}")


def watched_modules() -> list[ModuleType]:
    """The daemon's modules that use `threading`, as far as they are imported by now."""
    return [
        module
        for name, module in list(sys.modules.items())
        if name.startswith("mbot_agent.") and getattr(module, "threading", None) is threading
    ]
