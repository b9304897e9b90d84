"""How fast a robot drives and turns once it has picked up speed; measured and simulated alike."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbot_workstation.gap_report.compared_run import PATHS, ComparedRun
from mbot_workstation.recordings.track import Array

SETTLED_S = 0.6
"""Since the first command: even a motor of 200 ms has 95 % of its speed."""

SHORTEST_S = 0.5
"""Less driving than this says no speed: 4 mm of noise would be 2 % of it."""


@dataclass(frozen=True, slots=True)
class Rate:
    """Steady driving.

    Attributes:
        speed_mps: of the axle's centre, ahead; negative is backward.
        turn_radps: positive to the left.

    """

    speed_mps: float
    turn_radps: float


@dataclass(frozen=True, slots=True)
class RunRates:
    """One run's three rates; see `ComparedRun`."""

    maneuver: str
    measured: Rate
    calibrated: Rate
    nominal: Rate

    def rate(self, path: str) -> Rate:
        """By the path's name."""
        return {"measured": self.measured, "calibrated": self.calibrated}.get(path, self.nominal)


def steady_rates(runs: Sequence[ComparedRun]) -> tuple[RunRates, ...]:
    """Of every run that was driven long enough."""
    found: list[RunRates] = []
    for run in runs:
        if run.time_s[-1] >= SETTLED_S + SHORTEST_S:
            rates = {name: steady_rate(run.time_s, path) for name, path in run.paths().items()}
            found.append(RunRates(run.maneuver, *(rates[name] for name in PATHS)))
    return tuple(found)


def steady_rate(time_s: Array, path: Array) -> Rate:
    """Least squares over the steady part of a path.

    Args:
        time_s: since the first command, shape (n,).
        path: x, y, yaw; shape (n, 3).

    """
    steady = time_s >= SETTLED_S
    since_s, (x, y, yaw) = time_s[steady] - SETTLED_S, path[steady].T
    turn_radps, heading = np.polyfit(since_s, yaw, 1)
    # A robot that turns steadily and drives at v has gone v times this far.
    ways = np.exp(1j * (heading + turn_radps * since_s))
    gone = np.append(0, np.cumsum((ways[1:] + ways[:-1]) / 2 * np.diff(since_s)))
    columns = np.column_stack([np.ones_like(gone), gone])
    velocity = np.linalg.lstsq(columns, x + 1j * y, rcond=None)[0][1]
    return Rate(float(velocity.real), float(turn_radps))
