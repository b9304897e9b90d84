import itertools
import threading
import time

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from mbot_agent import metronome
from mbot_agent.metronome import (
    FRAME_AGE_TARGET_NS,
    LARGEST_SHIFT,
    Metronome,
    shift_towards_frames_ns,
)


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


def test_the_first_beat_is_now_and_the_grid_moves_as_it_is_told(clock: FakeClock) -> None:
    beat = Metronome(2.5)
    began_ns = clock.now_ns
    assert beat.wait(clock) == began_ns  # pyright: ignore[reportArgumentType]
    beat.shift(3_000_000)
    assert beat.wait(clock) == began_ns + 403_000_000  # pyright: ignore[reportArgumentType]
    assert clock.now_ns == began_ns + 403_000_000
    clock.now_ns += 400_000_000  # to the end of the period: this beat is due, and late by nothing
    assert beat.wait(clock) == began_ns + 803_000_000  # pyright: ignore[reportArgumentType]
    assert beat.missed == 0
    clock.now_ns += 800_000_000  # a whole one has passed by
    assert beat.wait(clock) == began_ns + 1_603_000_000  # pyright: ignore[reportArgumentType]
    assert beat.missed == 1


def test_a_late_beat_is_made_at_once(clock: FakeClock) -> None:
    beat = Metronome(2.5)
    beat.wait(clock)  # pyright: ignore[reportArgumentType]
    clock.now_ns += 500_000_000
    now_ns = clock.now_ns
    beat.wait(clock)  # pyright: ignore[reportArgumentType]
    assert clock.now_ns == now_ns


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


@given(st.floats(0.5, 20), st.floats(5, 120), st.floats(0, 1), st.integers(-3_000_000, 3_000_000))
@example(15.25, 5.0, 0.5915, 3_000_000)  # opposite the target: earlier and later are as far
def test_ticks_come_to_meet_the_frames(
    rate_hz: float, frame_rate_hz: float, phase: float, jitter_ns: int
) -> None:
    """Simulate a camera whose frames divide the period: the age settles at the target."""
    period_ns = round(1e9 / rate_hz)
    interval_ns = period_ns / max(1, round(frame_rate_hz / rate_hz))
    if interval_ns < 4 * FRAME_AGE_TARGET_NS:
        return
    offset_ns = phase * interval_ns
    for tick in range(2000):
        late_ns = jitter_ns if tick % 2 else -jitter_ns
        age_ns = round((offset_ns + late_ns) % interval_ns)
        shift_ns = shift_towards_frames_ns(age_ns, round(interval_ns), period_ns)
        assert abs(shift_ns) <= period_ns * LARGEST_SHIFT + 1
        offset_ns += shift_ns
    age_ns = offset_ns % interval_ns
    assert abs(age_ns - FRAME_AGE_TARGET_NS) <= 3_500_000 + period_ns * LARGEST_SHIFT


def test_ticks_go_the_shorter_way() -> None:
    """Half as far towards later: where both are as far, jitter would pull them to and fro."""
    interval_ns, period_ns = 100_000_000, 400_000_000
    for share, shift_ns in ((0.0, 0), (0.45, -4_000_000), (0.55, 2_000_000)):
        age_ns = FRAME_AGE_TARGET_NS + round(share * interval_ns)
        assert shift_towards_frames_ns(age_ns, interval_ns, period_ns) == shift_ns


def test_a_camera_of_unknown_rate_moves_nothing() -> None:
    assert shift_towards_frames_ns(20_000_000, 0, 400_000_000) == 0


def test_a_frame_that_was_lost_moves_nothing() -> None:
    age_ns = FRAME_AGE_TARGET_NS + 33_000_000
    assert shift_towards_frames_ns(age_ns, 33_000_000, 400_000_000) == 0
