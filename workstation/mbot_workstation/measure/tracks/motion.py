"""How fast something moves and turns: of a track, and of a run as the checks see it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbot_workstation.measure.tracks.maneuver import Maneuver, maneuver_named
from mbot_workstation.measure.tracks.run import Run
from mbot_workstation.measure.tracks.track import Array, Track, running_windows, without_sign_flips

STEP_S = 0.05
BIN_S = 0.1
"""Poses are averaged over this much before they are compared: 4 mm of noise become 1.3."""

SPIKE_POSES = 4
"""The running median before that reaches so far to each side: 0.1 s at 90 Hz in all, over which a
path is nearly straight. Spikes of up to four poses do not show."""

APART_S = 0.2
"""Between the two averages that make a speed: a drive's 0.4 m/s are 80 mm."""


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Rates on a grid of STEP_S. All of shape (n,).

    Attributes:
        time_s: on the track's clock.
        speed_mps: of the tracker, in space.
        turn_radps: of its attitude about any axis, never negative.
        yaw_radps: about the vertical, positive to the left.

    """

    time_s: Array
    speed_mps: Array
    turn_radps: Array
    yaw_radps: Array


def motion(track: Track) -> Motion:
    """Rates from averages APART_S apart; over a gap they are those from edge to edge."""
    grid_s = np.arange(track.time_s[0], track.time_s[-1] + STEP_S / 2, STEP_S)
    attitudes = without_sign_flips(track.quaternion_wxyz)
    reach = min(SPIKE_POSES, len(track) - 1)
    position = _averaged(track.time_s, _running_median(track.position_m, reach), grid_s)
    attitude = _averaged(track.time_s, _running_median(attitudes, reach), grid_s)
    attitude /= np.linalg.norm(attitude, axis=1, keepdims=True)
    yaw = np.interp(grid_s, track.time_s, track.yaw_rad)
    half = max(1, round(APART_S / STEP_S / 2))
    # Nearer to either end there is no speed; a very short track has one, from end to end.
    half = min(half, (len(grid_s) - 1) // 2)
    rows = np.arange(half, len(grid_s) - half)
    before, after = rows - half, rows + half
    elapsed_s = max(2 * half, 1) * STEP_S
    moved_m = np.linalg.norm(position[after] - position[before], axis=1)
    cosine = np.abs(np.sum(attitude[after] * attitude[before], axis=1)).clip(0, 1)
    return Motion(
        time_s=grid_s[rows],
        speed_mps=moved_m / elapsed_s,
        turn_radps=2 * np.arccos(cosine) / elapsed_s,
        yaw_radps=(yaw[after] - yaw[before]) / elapsed_s,
    )


def _running_median(values: Array, reach: int) -> Array:
    return np.median(running_windows(values, reach), axis=-1)


def _averaged(time_s: Array, values: Array, grid_s: Array) -> Array:
    """Mean of the rows within BIN_S around each grid time; a straight line across empty bins."""
    sums = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    first = np.searchsorted(time_s, grid_s - BIN_S / 2)
    last = np.searchsorted(time_s, grid_s + BIN_S / 2)
    counts = last - first
    full = counts > 0
    means = (sums[last[full]] - sums[first[full]]) / counts[full, None]
    columns = [np.interp(grid_s, grid_s[full], means[:, c]) for c in range(values.shape[1])]
    return np.stack(columns, axis=1)


MOVING_MPS = 0.08
MOVING_RADPS = 0.6
"""A fifth of full speed, a twelfth of a full spin; four times what 4 mm and 0.3 degrees of noise
make of a robot that stands."""


@dataclass(frozen=True, slots=True, eq=False)
class DrivenRun:
    """A run with its motion.

    Attributes:
        run: with the track as read.
        maneuver: what it was told.
        motion: from that track.

    """

    run: Run
    maneuver: Maneuver
    motion: Motion

    @classmethod
    def of(cls, run: Run) -> "DrivenRun":
        """Work out the motion."""
        return cls(run, maneuver_named(run.maneuver), motion(run.track))

    @property
    def name(self) -> str:
        """For messages."""
        return f"run {self.run.number} ({self.run.maneuver}, repetition {self.run.repetition})"

    @property
    def straight(self) -> bool:
        """Whether both motors were told the same."""
        return self.maneuver.left == self.maneuver.right

    @property
    def pace_mps(self) -> float:
        """The speed that it had while it moved; in whatever unit, so nothing absolute here."""
        speeds = self.motion.speed_mps
        return float(np.median(speeds[speeds >= 0.3 * np.quantile(speeds, 0.9)]))

    @property
    def yaw_radps(self) -> float:
        """The turn rate it had while it turned, positive to the left."""
        rates = self.motion.yaw_radps
        sizes = np.abs(rates)
        return float(np.median(rates[sizes >= 0.3 * np.quantile(sizes, 0.9)]))

    @property
    def turn_radps(self) -> float:
        """As `yaw_radps`, but about whatever axis, never negative."""
        rates = self.motion.turn_radps
        return float(np.median(rates[rates >= 0.3 * np.quantile(rates, 0.9)]))

    @property
    def moving_s(self) -> tuple[float, float] | None:
        """From when to when it moved or turned, on the track's clock; None if it never did."""
        rates = self.motion
        moves = (rates.speed_mps > MOVING_MPS) | (np.abs(rates.yaw_radps) > MOVING_RADPS)
        rows = np.flatnonzero(moves)
        return (float(rates.time_s[rows[0]]), float(rates.time_s[rows[-1]])) if len(rows) else None


def numbers_of(runs: Sequence[DrivenRun]) -> str:
    """Their numbers for a message, the first few: "run 3", "runs 1, 2, 3 and 77 more"."""
    numbers = [str(run.run.number) for run in runs]
    if len(numbers) == 1:
        return f"run {numbers[0]}"
    shown, rest = numbers[:4], len(numbers) - 4
    return f"runs {', '.join(shown)}" + (f" and {rest} more" if rest > 0 else "")
