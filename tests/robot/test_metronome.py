import itertools
import threading
import time

import pytest

from mbot_agent import metronome
from mbot_agent.metronome import Metronome


class FakeClock:
    """A monotonic clock that only `wait` and the test move; an Event that sleeps on it."""

    def __init__(self) -> None:
        self.now_ns = 1_000_000_000
        self.closing = False

    def monotonic_ns(self) -> int:
        return self.now_ns

    def wait(self, timeout_s: float) -> bool:
        self.now_ns += round(timeout_s * 1e9)
        return self.closing


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> FakeClock:
    fake = FakeClock()
    monkeypatch.setattr(metronome.time, "monotonic_ns", fake.monotonic_ns)
    return fake


def test_beats_stay_on_the_grid_whatever_a_tick_takes(clock: FakeClock) -> None:
    beat = Metronome(2.5)
    due: list[int] = []
    for busy_ms in (3, 390, 0, 120, 399):
        at = beat.wait(clock)  # pyright: ignore[reportArgumentType]
        assert at is not None
        due.append(at)
        clock.now_ns += busy_ms * 1_000_000
    assert [b - a for a, b in itertools.pairwise(due)] == [400_000_000] * 4
    assert beat.missed == 0


def test_missed_beats_are_skipped_and_counted_not_made_up(clock: FakeClock) -> None:
    beat = Metronome(2.5)
    first = beat.wait(clock)  # pyright: ignore[reportArgumentType]
    assert first is not None
    clock.now_ns += 2_100_000_000  # five whole periods and a half
    second = beat.wait(clock)  # pyright: ignore[reportArgumentType]
    third = beat.wait(clock)  # pyright: ignore[reportArgumentType]
    assert beat.missed == 4
    assert second == first + 5 * 400_000_000
    assert third == first + 6 * 400_000_000


def test_closing_ends_the_wait() -> None:
    beat = Metronome(0.5)
    closing = threading.Event()
    assert beat.wait(closing) is not None
    closing.set()
    started = time.monotonic()
    assert beat.wait(closing) is None
    assert time.monotonic() - started < 1.0
