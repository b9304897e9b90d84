"""A phase-locked beat: ticks stay on one grid, late ones are skipped and counted, never made up."""

import threading
import time


class Metronome:
    """Beats at a fixed rate on the monotonic clock.

    Attributes:
        missed: beats skipped so far because the previous tick took too long.

    """

    def __init__(self, rate_hz: float) -> None:
        self.period_ns = round(1e9 / rate_hz)
        self.missed = 0
        self._next_ns = time.monotonic_ns()

    def wait(self, closing: threading.Event) -> int | None:
        """Wait for the next beat.

        Returns:
            The monotonic time in ns at which the beat was due; None once `closing` is set.

        """
        late_ns = time.monotonic_ns() - self._next_ns
        if late_ns >= self.period_ns:
            skipped = late_ns // self.period_ns
            self.missed += skipped
            self._next_ns += skipped * self.period_ns
        due_ns = self._next_ns
        self._next_ns += self.period_ns
        if closing.wait(max(0, due_ns - time.monotonic_ns()) / 1e9):
            return None
        return due_ns
