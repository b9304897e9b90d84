"""Runs that the fitted robot cannot explain: found by their deviations, and named."""

import numpy as np
from numpy.typing import NDArray

from mbot_workstation.measure.identification.exclusion import Exclusion, Fault
from mbot_workstation.measure.identification.observed_run import maneuvers
from mbot_workstation.measure.identification.solver import Problem, Solution
from mbot_workstation.measure.identification.variance_components import ROBUST
from mbot_workstation.measure.tracks.track import Array

FAR = 6.0
"""Standard deviations from the other repetitions."""

LEAST_STRENGTH = 0.05
"""A motor that differs by less from the other repetitions is usual."""

LEAST_PLACE_M, LEAST_HEADING_RAD = 0.015, 0.05
"""A simulation that is nearer than this all the time explains a run well enough."""


def outlying_runs(problem: Problem, solution: Solution) -> dict[int, Exclusion]:
    """Why a run is an outlier, by its index in the problem."""
    strength = solution.state.nuisance[:, :2]
    misfit = np.array([_misfit(rows) for rows in solution.residuals])
    usual = np.median(misfit, axis=0)
    found: dict[int, Exclusion] = {}
    for members in maneuvers(problem.runs).values():
        # Straight on, what a robot does by chance takes it further.
        usual_here = np.maximum(usual, np.median(misfit[members], axis=0))
        for index in members:
            why = _odd_strength(strength, index, np.array(members))
            if why is None:
                why = _odd_misfit(misfit[index], usual_here)
            if why is not None:
                found[index] = why
    return found


def _misfit(increments: Array) -> tuple[float, float]:
    """How far off the run is while it drives: place [m] and heading [rad]."""
    ahead, left, turned = np.cumsum(increments, axis=1)
    return float(np.quantile(np.hypot(ahead, left), 0.9)), float(np.quantile(np.abs(turned), 0.9))


def _odd_strength(strength: Array, index: int, group: NDArray[np.intp]) -> Exclusion | None:
    off = strength[group] - np.median(strength[group], axis=0)
    mine = strength[index] - np.median(strength[group], axis=0)
    usual = ROBUST * np.median(np.abs(off), axis=0)
    for side, name in enumerate(("left", "right")):
        if abs(mine[side]) > max(LEAST_STRENGTH, FAR * usual[side]):
            more = "stronger" if mine[side] > 0 else "weaker"
            why = (
                f"its {name} motor was {100 * abs(mine[side]):.0f} % {more} than in the other "
                "repetitions"
            )
            return Exclusion(Fault.ODD_MOTOR, why)
    return None


def _odd_misfit(misfit: Array, usual: Array) -> Exclusion | None:
    place_m, heading_rad = misfit
    if place_m > max(LEAST_PLACE_M, FAR * usual[0]) or heading_rad > max(
        LEAST_HEADING_RAD, FAR * usual[1]
    ):
        return Exclusion(
            Fault.UNLIKE_MODEL,
            f"no such robot drives like this: off by {100 * place_m:.0f} cm or "
            f"{np.degrees(heading_rad):.0f} degrees within the run, where others are off by "
            f"{100 * usual[0]:.1f} cm and {np.degrees(usual[1]):.1f} degrees",
        )
    return None
