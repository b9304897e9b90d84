"""Runs that were not fitted: which they are, and how far the simulation ends from them."""

import math
from collections.abc import Sequence
from statistics import median

import numpy as np

from mbot_workstation.identification.estimate import Repeatability, RunError
from mbot_workstation.identification.run_view import RunView, simulate_views
from mbot_workstation.recordings.track import Array
from mbot_workstation.simulation.robot_parameters import RobotParameters

LEAST_TURNS_RAD = 2 * math.pi
"""From one turn on, a heading's error is told as a share of what was turned."""

AT_S = 10.0
"""After the first command, or at the last one if that comes sooner."""


def is_held_out(views: Sequence[RunView]) -> list[bool]:
    """Every other repetition of each manoeuvre, the first one kept for the fit."""
    seen: dict[str, int] = {}
    order = sorted(
        range(len(views)),
        key=lambda i: (
            views[i].flat.run.maneuver,
            views[i].flat.recording,
            views[i].flat.run.repetition,
            views[i].flat.run.number,
        ),
    )
    result = [False] * len(views)
    for index in order:
        name = views[index].flat.run.maneuver
        seen[name] = seen.get(name, 0) + 1
        result[index] = seen[name] % 2 == 0
    return result


def errors(
    views: Sequence[RunView], settings: Array, before: RobotParameters, after: RobotParameters
) -> tuple[RunError, ...]:
    """Drive each run with both robots from where it began, and compare the ends.

    Args:
        views: held-out runs.
        settings: of the recordings, shape (recordings, 5).
        before, after: the robots.

    """
    calm = [np.zeros(view.deviations) for view in views]
    old = simulate_views(views, [before] * len(views), calm)
    new = simulate_views(views, [after] * len(views), calm)
    result: list[RunError] = []
    for view, old_path, new_path in zip(views, old, new, strict=True):
        setting = settings[view.flat.recording]
        at_s = min(AT_S, view.covered_s[1])
        old_m, old_rad = view.end_error(old_path, setting, at_s)
        new_m, new_rad = view.end_error(new_path, setting, at_s)
        _, turned_rad = view.end(setting, at_s)
        run = view.flat.run
        result.append(
            RunError(view.flat.name, run.maneuver, at_s, old_m, new_m, old_rad, new_rad, turned_rad)
        )
    return tuple(result)


def heading_share(off_and_turned_rad: Sequence[tuple[float, float]]) -> float | None:
    """How far headings are off, as a share of the angle turned: the middle one of runs that turn.

    Args:
        off_and_turned_rad: of each run; runs of less than a turn don't count.

    """
    shares = [
        abs(off / turned) for off, turned in off_and_turned_rad if abs(turned) >= LEAST_TURNS_RAD
    ]
    return median(shares) if shares else None


def repeatability(views: Sequence[RunView], settings: Array) -> tuple[Repeatability, ...]:
    """How far repetitions are apart, for each manoeuvre that has at least two."""
    result: list[Repeatability] = []
    for name in dict.fromkeys(view.flat.run.maneuver for view in views):
        chosen = [view for view in views if view.flat.run.maneuver == name]
        if len(chosen) < 2:
            continue
        at_s = min(AT_S, *(view.covered_s[1] for view in chosen))
        ends = np.array([view.end(settings[view.flat.recording], at_s) for view in chosen])
        off = ends - ends.mean(axis=0)
        spread = (np.abs(off) ** 2).sum(axis=0) / (len(chosen) - 1)
        place_m, heading_rad = np.sqrt(spread.real)
        result.append(Repeatability(name, float(place_m), float(heading_rad)))
    return tuple(result)
