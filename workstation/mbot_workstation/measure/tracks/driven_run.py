"""A run as the checks see it: with its motion worked out once."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbot_workstation.measure.tracks.maneuver import Maneuver, maneuver_named
from mbot_workstation.measure.tracks.motion import Motion, motion
from mbot_workstation.measure.tracks.run import Run

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
