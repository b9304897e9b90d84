"""systemd's watchdog is fed only while everything that stops the robot makes progress."""

import logging
import time
from collections.abc import Callable, Mapping

from mbot_agent.process.service_manager import notify

log = logging.getLogger(__name__)

LONGEST_PAUSE_NS = 1_000_000_000
"""Each part shows itself at least twice a second, driving or standing."""


class Watchdog:
    """Asked at every tick of the control loop, which is the first of the parts watched."""

    def __init__(self, progress_ns: Mapping[str, Callable[[], int]]) -> None:
        """`progress_ns`: when each part was last seen to work, monotonic, by its name."""
        self._progress_ns = progress_ns
        self._stuck: list[str] = []

    def feed(self, status: str) -> bool:
        """Tell systemd that all is well, if it is; the status is for people."""
        now_ns = time.monotonic_ns()
        stuck = [
            name
            for name, seen_ns in self._progress_ns.items()
            if now_ns - seen_ns() > LONGEST_PAUSE_NS
        ]
        if stuck != self._stuck:
            if stuck:
                log.error("no progress: %s; the watchdog is not fed", ", ".join(stuck))
            else:
                log.warning("all parts make progress again")
            self._stuck = stuck
        notify(f"STATUS={status}" if stuck else f"WATCHDOG=1\nSTATUS={status}")
        return not stuck
