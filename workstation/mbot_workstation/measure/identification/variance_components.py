"""Variance components of repetitions, of the model's misfit and of a tracker's noise, from a fit.

The scatter of runs comes from repetitions of the same maneuver only: what is wrong in all of
them is the model's fault, and is kept apart as misfit.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from mbot_workstation.measure.identification.observed_run import BIN_S, ObservedRun, maneuvers
from mbot_workstation.measure.identification.prediction import NUISANCE, Noise
from mbot_workstation.measure.identification.solver import Solution, VarianceComponents
from mbot_workstation.measure.tracks.track import Array

ASSUMED = VarianceComponents()
ASSUMED_COUNT = 2.0
"""The usual scatter counts as much as so many runs: two repetitions alone say little."""

POSSIBLE_SCATTER = (1e-4, 0.3)
"""Of a motor's speed from run to run: less no tracker shows, more no robot drives with."""

SUMMED = 10
"""Increments in a sum: over a second, what the robot does by chance outweighs the tracker."""

ROBUST = 1.4826
"""Standard deviation of normal numbers by their median distance from 0."""


def estimate_variances(runs: Sequence[ObservedRun], solution: Solution) -> VarianceComponents:
    """From the deviations of runs from their maneuver's mean, and of maneuvers from the model."""
    nuisance = solution.state.nuisance
    off, freedom = np.zeros_like(nuisance), np.zeros(len(nuisance))
    for members in maneuvers(runs).values():
        if len(members) > 1:
            off[members] = nuisance[members] - nuisance[members].mean(axis=0)
            freedom[members] = 1 - 1 / len(members)
    driven = np.array([_driven(run) for run in runs])
    battery, motor = common_and_individual(off[:, :2], freedom, driven)
    shared = np.array([not run.own_clock for run in runs])
    delay = NUISANCE.index("delay")
    return VarianceComponents(
        battery=battery,
        motor=motor,
        sideways=float(np.sqrt(_mean(off[:, 2] ** 2, freedom, ASSUMED.sideways**2))),
        moment_s=float(
            np.sqrt(_mean(off[shared, delay] ** 2, freedom[shared], ASSUMED.moment_s**2))
        ),
        misfit=ASSUMED.misfit,
    )


def estimate_misfit(solution: Solution, told: float) -> float:
    """What the model gets wrong in a maneuver, as a share of the faster wheel's speed.

    Args:
        solution: at the end.
        told: how many numbers of the steady motion the parameters follow freely.

    """
    wheels = np.array([misfit[:2] for misfit in solution.state.misfit.values()])
    freedom = max(wheels.size - told, wheels.size / 4)
    return max(float(np.sqrt((wheels**2).sum() / freedom)), ASSUMED.misfit)


def estimate_noise(
    runs: Sequence[ObservedRun], solution: Solution, before: Sequence[Noise]
) -> list[Noise]:
    """Of each recording's tracker and of the robot's chance, from what nothing explains.

    Neighbouring increments share a bin's error, so it cancels in a sum of many; what the robot does
    by chance adds up.
    """
    result: list[Noise] = []
    for recording, known in enumerate(before):
        mine = [i for i, run in enumerate(runs) if run.flat.recording == recording]
        if not mine:
            result.append(known)
            continue
        count = float(np.median(np.concatenate([runs[i].bins.count for i in mine])))
        left = [solution.residuals[i] for i in mine]
        place_m, place_walk = _parts([rows[:2] for rows in left], count)
        heading_rad, heading_walk = _parts([rows[2:] for rows in left], count)
        result.append(
            replace(
                known,
                place_m=max(place_m, 1e-4),
                heading_rad=max(heading_rad, 1e-4),
                place_walk=max(place_walk, 2e-4),
                heading_walk=max(heading_walk, 1e-3),
            )
        )
    return result


def _parts(rows: Sequence[Array], count: float) -> tuple[float, float]:
    """Noise of a single sample, and the walk per root of a second."""
    single = _variance(np.concatenate([row.ravel() for row in rows]))
    sums = [
        row[:, : row.shape[1] // SUMMED * SUMMED].reshape(row.shape[0], -1, SUMMED).sum(axis=2)
        for row in rows
    ]
    summed = _variance(np.concatenate([one.ravel() for one in sums]))
    walk = max(summed - single, 0.0) / ((SUMMED - 1) * BIN_S)
    of_bin = max(single - walk * BIN_S, 0.1 * single) / 2
    return float(np.sqrt(of_bin * count)), float(np.sqrt(walk))


def _variance(values: Array) -> float:
    return (ROBUST * float(np.median(np.abs(values)))) ** 2 if values.size else 0.0


def common_and_individual(
    off: Array, freedom: Array, driven: NDArray[np.bool_]
) -> tuple[float, float]:
    """Scatter that both motors have in common, and of each by itself: the likeliest two.

    Where both are driven, their sum scatters by twice what is common more than their difference;
    one alone scatters by both. What is estimated decides how the next fit shares a deviation among
    the wheels, so a difference of two means will not do: it comes out negative by chance, and is
    then taken for certain.

    Args:
        off: of both wheels' speeds in each run from the mean of its maneuver, shape (runs, 2).
        freedom: of each run, shape (runs,).
        driven: which wheels, shape (runs, 2).

    Returns:
        Standard deviations, as shares of a wheel's speed.

    """
    both, alone = driven.all(axis=1), driven.any(axis=1) & ~driven.all(axis=1)
    together = off[both] @ np.array([[1, 1], [1, -1]]) / np.sqrt(2)
    one = np.where(driven, off, 0).sum(axis=1)[alone]
    common, each = np.array([2, 0, 1]), ASSUMED.battery**2 * np.array([2, 0, 1])
    count = np.array([freedom[both].sum(), freedom[both].sum(), freedom[alone].sum()])
    squares = np.array([*(together**2).sum(axis=0), (one**2).sum()])
    count, squares = count + ASSUMED_COUNT, squares + ASSUMED_COUNT * (each + ASSUMED.motor**2)

    def unlikeliness(logs: Array) -> float:
        variance = common * np.exp(2 * logs[0]) + np.exp(2 * logs[1])
        return float((count * np.log(variance) + squares / variance).sum())

    start = np.log([ASSUMED.battery, ASSUMED.motor])
    found = minimize(unlikeliness, start, bounds=[np.log(POSSIBLE_SCATTER)] * 2)
    battery, motor = np.exp(found.x).tolist()
    return battery, motor


def _mean(squares: Array, freedom: Array, assumed: float) -> float:
    return float((squares.sum() + ASSUMED_COUNT * assumed) / (freedom.sum() + ASSUMED_COUNT))


def _driven(run: ObservedRun) -> tuple[bool, bool]:
    commands = run.flat.run.commands
    return bool(commands.left.any()), bool(commands.right.any())
