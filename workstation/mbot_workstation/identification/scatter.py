"""How much runs differ from the simulation and from each other, learnt from the runs themselves."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbot_workstation.identification.binning import ROBUST
from mbot_workstation.identification.run_terms import MOMENT, OWN, PLACE, SIDES, STRENGTH, Residual
from mbot_workstation.identification.run_view import RunView
from mbot_workstation.recordings.track import Array


def usual_scatter() -> "Scatter":
    """Of good runs, before anything is known about these."""
    return Scatter(
        place_floor_m=0.002,
        heading_floor_rad=0.005,
        load=0.005,
        strength=0.003,
        wander=0.005,
        moment_s=0.001,
    )


OWN_CLOCK_S = 0.1
"""How uncertain a run's beginning is when its clock is its own."""


@dataclass(frozen=True, slots=True)
class Scatter:
    """Standard deviations. The defaults are wide, for a fit that has just begun.

    Attributes:
        place_m, heading_rad: of a single sample.
        place_floor_m, heading_floor_rad: of a bin, however many samples it has: what the model
            can't follow.
        load: of both motors' strength alike, from run to run and from manoeuvre to manoeuvre: a
            turn loads motors otherwise than a straight line, which the model may not know.
        strength: of each motor, from run to run, as a share.
        wander: likewise from second to second.
        moment_s: of a run's beginning.
        centre_m: of the point about which the robot turns.

    """

    place_m: float = 0.004
    heading_rad: float = 0.005
    place_floor_m: float = 0.02
    heading_floor_rad: float = 0.05
    load: float = 0.02
    strength: float = 0.02
    wander: float = 0.01
    moment_s: float = 0.005
    centre_m: float = 0.002

    def own(self, view: RunView) -> Array:
        """Of a run's own deviations. Shape (deviations,)."""
        moment_s = OWN_CLOCK_S if view.own_clock else self.moment_s
        sides = [self.strength, self.strength]
        whole = [self.load, *sides, moment_s, self.centre_m, self.centre_m]
        return np.concatenate([whole, np.full(2 * view.pieces, self.wander)])

    def bins(self, residual: Residual) -> Array:
        """Of a run's bins. Shape (3, bins)."""
        single = np.array([self.place_m, self.place_m, self.heading_rad])[:, None]
        floor = np.array([self.place_floor_m, self.place_floor_m, self.heading_floor_rad])[:, None]
        return np.sqrt(single**2 / residual.samples + floor**2)


def learn_scatter(
    views: Sequence[RunView],
    residuals: Sequence[Residual],
    deviations: Sequence[Array],
    unknown: Sequence[Array],
    *,
    about_maneuvers: bool,
) -> Scatter:
    """What the runs say, after a fit.

    Args:
        views, residuals: the runs.
        deviations: of each run.
        unknown: which share of its variance each deviation keeps, given the run's data.
        about_maneuvers: take strengths and moments from the mean of the same manoeuvre. What all
            repetitions have in common is then the model's fault and counts in full against the
            parameters, as it should in the fit. Otherwise it is taken for scatter, as it should in
            intervals: nobody knows what the model would get wrong in the next manoeuvre.

    """
    own = np.array([deviation[: len(OWN)] for deviation in deviations])
    known = np.array([1 - share[: len(OWN)].clip(0, 1) for share in unknown])
    wander = np.concatenate([deviation[len(OWN) :] for deviation in deviations])
    wander_known = np.concatenate([1 - share[len(OWN) :].clip(0, 1) for share in unknown])
    repeated = _about_maneuvers(views, own) if about_maneuvers else own
    shared = np.array([not view.own_clock for view in views])
    place = float(np.median([one.scatter[0] for one in residuals]))
    heading = float(np.median([one.scatter[1] for one in residuals]))
    return Scatter(
        place,
        heading,
        max(_floor([one.value[:2] for one in residuals], place, residuals), 0.0003),
        max(_floor([one.value[2:] for one in residuals], heading, residuals), 0.0003),
        load=_size(own[:, STRENGTH], known[:, STRENGTH], 0.0005, 0.2),
        strength=_size(repeated[:, SIDES], known[:, SIDES], 0.0005, 0.2),
        wander=_size(wander, wander_known, 0.0005, 0.1),
        moment_s=_size(repeated[shared, MOMENT], known[shared, MOMENT], 0.0005, 0.05),
        centre_m=_size(own[:, PLACE], known[:, PLACE], 0.0002, 0.02),
    )


def _size(deviations: Array, known: Array, least: float, most: float) -> float:
    """By those deviations that the data say something about (MacKay's fixed point)."""
    size = float(np.sqrt((deviations**2).sum() / max(float(known.sum()), 0.5)))
    return min(max(size, least), most)


def _floor(values: Sequence[Array], single: float, residuals: Sequence[Residual]) -> float:
    """What bins scatter beyond their single samples, robustly."""
    size = ROBUST * float(np.median(np.abs(np.concatenate([v.ravel() for v in values]))))
    samples = float(np.median(np.concatenate([one.samples.ravel() for one in residuals])))
    return float(np.sqrt(max(size**2 - single**2 / samples, 0)))


def _about_maneuvers(views: Sequence[RunView], own: Array) -> Array:
    names = np.array([view.flat.run.maneuver for view in views])
    result = own.copy()
    for name in np.unique(names):
        chosen = names == name
        count = int(chosen.sum())
        if count > 1:
            off = own[chosen] - own[chosen].mean(axis=0)
            result[chosen] = off * np.sqrt(count / (count - 1))
    return result
