"""Waiting for what happens elsewhere: in a thread, in a process, at the other end of a wire."""

import time
from collections.abc import Callable

ASK_EVERY_S = 0.005


def until(condition: Callable[[], object], timeout_s: float = 30.0) -> bool:
    """Whether it has come true in time; a machine that stalls is not what ends the wait."""
    deadline_s = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > deadline_s:
            return False
        time.sleep(ASK_EVERY_S)
    return True
