"""Runs that the fitted robot cannot explain: found by their deviations, and named."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mbot_workstation.identification.binning import ROBUST
from mbot_workstation.identification.linearisation import Fixed
from mbot_workstation.identification.mixed_fit import MixedFit, begin
from mbot_workstation.identification.run_terms import OWN, SIDES, STRENGTH, Residual
from mbot_workstation.identification.run_view import RunView
from mbot_workstation.recordings.track import Array

FAR = 6.0
"""Standard deviations from the other repetitions."""

LEAST_STRENGTH = 0.05
"""A motor that differs by less from the other repetitions is usual."""

LEAST_PLACE_M, LEAST_HEADING_RAD = 0.015, 0.05
"""A simulation that is nearer than this all the time explains a run well enough."""

ROUNDS = 6


def stray_runs(fit: MixedFit, others: Sequence[RunView]) -> dict[int, str]:
    """Look at fitted and other runs alike.

    Args:
        fit: finished.
        others: runs that were not fitted.

    Returns:
        Why a run is stray, by its index in `fit.views` followed by `others`.

    """
    views, deviations = [*fit.views], [*fit.state.deviations]
    residuals = [*fit.here.residuals]
    if others:
        held = Fixed(fit.state.settings, np.zeros_like(fit.fixed.free))
        start = begin(others, fit.state.robot, fit.state.settings)
        trial = MixedFit(others, held, start)  # with a wide scatter, to come near first
        trial.run((), ROUNDS)
        trial.scatter = fit.scatter
        trial.run((), ROUNDS, learn=False)
        views += others
        deviations += trial.state.deviations
        residuals += trial.here.residuals
    own = np.array([deviation[: len(OWN)] for deviation in deviations])
    strength = own[:, STRENGTH, None] + own[:, SIDES]
    misfit = np.array([_misfit(residual) for residual in residuals])
    usual = np.median(misfit, axis=0)
    found: dict[int, str] = {}
    for index, view in enumerate(views):
        group = [v.flat.run.maneuver == view.flat.run.maneuver for v in views]
        why = _odd_strength(strength, index, np.array(group))
        if why is None:
            why = _odd_misfit(misfit[index], usual)
        if why is not None:
            found[index] = why
    return found


def _misfit(residual: Residual) -> tuple[float, float]:
    place = np.hypot(residual.value[0], residual.value[1])
    return float(np.quantile(place, 0.9)), float(np.quantile(np.abs(residual.value[2]), 0.9))


def _odd_strength(strength: Array, index: int, group: NDArray[np.bool_]) -> str | None:
    middle = np.median(strength[group], axis=0)
    off = strength - middle
    usual = ROBUST * np.median(np.abs(off[group]), axis=0)
    for side, name in enumerate(("left", "right")):
        if abs(off[index, side]) > max(LEAST_STRENGTH, FAR * usual[side]):
            more = "stronger" if off[index, side] > 0 else "weaker"
            return (
                f"its {name} motor was {100 * abs(off[index, side]):.0f} % {more} than in the "
                "other repetitions"
            )
    return None


def _odd_misfit(misfit: Array, usual: Array) -> str | None:
    place_m, heading_rad = misfit
    if place_m > max(LEAST_PLACE_M, FAR * usual[0]) or heading_rad > max(
        LEAST_HEADING_RAD, FAR * usual[1]
    ):
        return (
            f"no such robot drives like this: off by {100 * place_m:.0f} cm or "
            f"{np.degrees(heading_rad):.0f} degrees within the run, where others are off by "
            f"{100 * usual[0]:.1f} cm and {np.degrees(usual[1]):.1f} degrees"
        )
    return None
