"""Keeps a loop on a grid of real time: no drift, and no burst after a stall."""

import threading
import time


class Pacer:
    """Ticks at start + n * period on the monotonic clock.

    Attributes:
        lost: ticks given up after stalls so far.

    """

    def __init__(self, period_s: float, most_at_once: int) -> None:
        """Start the grid now.

        Args:
            period_s: from tick to tick.
            most_at_once: so many ticks may be caught up after being late; more are given up.

        """
        self._period_s = period_s
        self._most_at_once = most_at_once
        self._start_s = time.monotonic()
        self._ticks = 0
        self.lost = 0

    @property
    def tick_s(self) -> float:
        """When the last tick was due, on the monotonic clock; however late anybody woke up."""
        return self._start_s + self._ticks * self._period_s

    def wait(self, stop: threading.Event) -> int:
        """Sleep until the next tick.

        Returns:
            How many ticks have passed since the last call, 1 if on time; 0 when `stop` is set.

        """
        next_s = self._start_s + (self._ticks + 1) * self._period_s
        if stop.wait(max(0.0, next_s - time.monotonic())):
            return 0
        passed = int((time.monotonic() - self._start_s) / self._period_s) - self._ticks
        passed = max(1, passed)  # rounding at the very tick
        self._ticks += passed
        kept = min(passed, self._most_at_once)
        self.lost += passed - kept
        return kept
