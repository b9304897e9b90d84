"""A phase-locked beat: ticks stay on one grid, late ones are skipped and counted, never made up."""

import threading
import time

FRAME_AGE_TARGET_NS = 6_000_000
"""How old the newest frame should be at a tick: young, with room for a frame that comes late."""

LARGEST_SHIFT = 0.01
"""Of a period, for one tick: the beat follows the camera without anybody noticing."""


def shift_towards_frames_ns(age_ns: int, interval_ns: int, period_ns: int) -> int:
    """How much later the next ticks should be so that each finds a frame just arrived.

    Without this a camera whose rate is a multiple of the tick's keeps whatever age the first
    frame happened to have, up to a whole frame interval (33 ms at 30 frames/s), for ever.

    Args:
        age_ns: of the newest frame at a tick; a frame lost in between does not matter.
        interval_ns: between two frames.
        period_ns: between two ticks.

    """
    if interval_ns <= 0:
        return 0
    half_ns = interval_ns // 2
    late_ns = (age_ns - FRAME_AGE_TARGET_NS + half_ns) % interval_ns - half_ns
    limit_ns = round(period_ns * LARGEST_SHIFT)
    # Half as far one way: where both are as far, frames that jitter would else pull to and fro.
    return -max(-limit_ns // 2, min(limit_ns, late_ns))


class Metronome:
    """Beats at a fixed rate on the monotonic clock.

    Attributes:
        missed: beats skipped so far because the previous tick took too long.

    """

    def __init__(self, rate_hz: float) -> None:
        self.period_ns = round(1e9 / rate_hz)
        self.missed = 0
        self._next_ns = time.monotonic_ns()

    def shift(self, shift_ns: int) -> None:
        """Move the whole grid from the next beat on; positive is later."""
        self._next_ns += shift_ns

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
