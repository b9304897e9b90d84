"""One track of a whole session: which part of it belongs to which run?

The tracker's clock is not the robot's, so the commands are laid over the track at every offset and
compared with how fast it moves and turns. Only amounts are compared: axes, units and signs may
still be wrong here, and between runs the robot may be carried about.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.measure.tracks.commands_csv import CommandedRun
from mbot_workstation.measure.tracks.motion import STEP_S, motion
from mbot_workstation.measure.tracks.track import Array, Track

MARGIN_S = 1.0
"""Of standing still, compared and kept before and after each run."""

CLEAR_MISFIT_RATIO = 0.7
"""The right offset fits far better than one next to it; measured about 0.1 to 0.4."""

APART_S = 2.0
"""Offsets further apart than this count as different answers."""


def find_tracker_ahead_s(runs: Sequence[CommandedRun], track: Track) -> float:
    """The tracker's clock minus the robot's, to about 0.1 s.

    Raises:
        ConfigurationError: the commands fit nowhere, or at several places alike.

    """
    speed, turning = _activity(track)
    robot_start_s = min(run.commands.start_s for run in runs) - MARGIN_S
    robot_end_s = max(run.commands.end_s for run in runs) + MARGIN_S
    grid_s = np.arange(robot_start_s, robot_end_s + STEP_S, STEP_S)
    weight, drive, turn = _expected(runs, grid_s)
    # A track that begins late or ends early leaves the commands hanging over by up to all.
    padding = len(grid_s)
    turn_misfit = _misfit(weight, turn, np.pad(turning, padding), padding)
    misfit = turn_misfit + _misfit(weight, drive, np.pad(speed, padding), padding)
    # Where positions change their unit half way, turning alone still tells; units are found later.
    offset = _clearest(misfit)
    if offset is None and turn.any():
        offset = _clearest(turn_misfit)
    if offset is None:
        raise ConfigurationError(
            "the commands are nowhere to be found in the track: no offset between the two clocks "
            "fits clearly better than others; is it the track of this session?"
        )
    return float(track.time_s[0] + (offset - padding) * STEP_S - grid_s[0])


def _clearest(misfit: Array) -> int | None:
    """The best offset, if it is far better than all that are not next to it."""
    best = int(np.argmin(misfit))
    apart = np.abs(np.arange(len(misfit)) - best) * STEP_S > APART_S
    rival = float(misfit[apart].min()) if apart.any() else float("inf")
    return best if misfit[best] <= CLEAR_MISFIT_RATIO * rival else None


def parts_of(
    track: Track, runs: Sequence[CommandedRun], tracker_ahead_s: float
) -> list[Track | None]:
    """Each run's part of the session's track, with a margin of standing still; None if there is
    none. Where runs follow each other closely they share the time between.
    """
    order = sorted(runs, key=lambda run: run.commands.start_s)
    margins: dict[int, tuple[float, float]] = {run.number: (MARGIN_S, MARGIN_S) for run in runs}
    for first, second in pairwise(order):
        gap_s = max(0.0, second.commands.start_s - first.commands.end_s)
        share_s = min(MARGIN_S, gap_s / 2)
        margins[first.number] = (margins[first.number][0], share_s)
        margins[second.number] = (share_s, margins[second.number][1])
    return [
        track.between(
            run.commands.start_s + tracker_ahead_s - margins[run.number][0],
            run.commands.end_s + tracker_ahead_s + margins[run.number][1],
        )
        for run in runs
    ]


def _activity(track: Track) -> tuple[Array, Array]:
    """How fast it moves and how fast it turns on a grid of STEP_S, 1 at a fast drive's pace."""
    rates = motion(track)
    return _scaled(rates.speed_mps), _scaled(rates.turn_radps)


def _scaled(rates: Array) -> Array:
    """Rates with the 80th percentile of those that are not nearly 0 as 1, and nothing above 1.

    Being carried about is no faster than driving then, and units do not matter.
    """
    moving = rates[rates > 0.1 * np.quantile(rates, 0.95)]
    top = float(np.quantile(moving, 0.8)) if len(moving) else 0.0
    return np.minimum(rates / top, 1.0) if top > 0 else np.zeros_like(rates)


def _expected(runs: Sequence[CommandedRun], grid_s: Array) -> tuple[Array, Array, Array]:
    """Where to compare (1 or 0), and the expected amounts of driving and turning."""
    weight, drive, turn = (np.zeros_like(grid_s) for _ in range(3))
    for run in runs:
        series = run.commands
        near = (grid_s >= series.start_s - MARGIN_S) & (grid_s <= series.end_s + MARGIN_S)
        left, right = series.at(grid_s)
        weight[near] = 1
        drive += np.abs(left + right) / 2
        turn += np.abs(right - left) / 2
    return weight, drive, turn


def _misfit(weight: Array, expected: Array, measured: Array, padding: int) -> Array:
    """Weighted sum of squares of measured minus expected, for every offset of the commands."""
    size = len(measured) + len(weight)
    spectrum = np.fft.rfft(measured, size)

    def correlate(template: Array, values: NDArray[np.complex128]) -> Array:
        product = values * np.conj(np.fft.rfft(template, size))
        return np.fft.irfft(product, size)[: len(measured) - padding]

    squares = np.fft.rfft(measured**2, size)
    return (
        correlate(weight, squares)
        - 2 * correlate(weight * expected, spectrum)
        + float(np.sum(weight * expected**2))
    )
