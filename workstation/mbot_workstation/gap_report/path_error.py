"""How far simulated paths are from measured ones, as time goes by, across repetitions."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbot_workstation.gap_report.compared_run import ComparedRun
from mbot_workstation.recordings.track import Array

STEP_S = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class Band:
    """One value a moment: the middle of all repetitions, and how far they reach.

    Attributes:
        middle: the median, shape (n,).
        low, high: the least and the largest, shape (n,).

    """

    middle: Array
    low: Array
    high: Array

    @classmethod
    def of(cls, rows: Array) -> "Band":
        """Of several repetitions, shape (repetitions, n)."""
        return cls(np.median(rows, axis=0), rows.min(axis=0), rows.max(axis=0))


@dataclass(frozen=True, slots=True, eq=False)
class PathError:
    """Simulated against measured, of one manoeuvre by one simulated robot.

    Attributes:
        time_s: shape (n,); as long as the shortest repetition.
        position_m: distance between the two places, never negative.
        yaw_rad: difference of the two headings, never negative; more than a turn is possible.
        position_at_end_m, yaw_at_end_rad: at the end of each repetition, shape (repetitions,).

    """

    time_s: Array
    position_m: Band
    yaw_rad: Band
    position_at_end_m: Array
    yaw_at_end_rad: Array


def path_error(runs: Sequence[ComparedRun], simulated: str) -> PathError:
    """Of all repetitions of one manoeuvre.

    Args:
        runs: at least one.
        simulated: "calibrated" or "nominal".

    """
    time_s = np.arange(0, min(run.time_s[-1] for run in runs) + STEP_S / 2, STEP_S)
    position_m, yaw_rad = [], []
    for run in runs:
        away = run.paths()[simulated] - run.measured
        distance = np.hypot(away[:, 0], away[:, 1])
        position_m.append(np.interp(time_s, run.time_s, distance))
        yaw_rad.append(np.interp(time_s, run.time_s, np.abs(away[:, 2])))
    positions, yaws = np.array(position_m), np.array(yaw_rad)
    return PathError(time_s, Band.of(positions), Band.of(yaws), positions[:, -1], yaws[:, -1])
