"""Measured and simulated paths over each other, from above."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from mbot_workstation.gap_report.compared_run import CALIBRATED, MEASURED, NOMINAL, ComparedRun
from mbot_workstation.gap_report.svg import COLOURS, INK, styled, to_svg
from mbot_workstation.recordings.track import Array

SMALLEST_SIDE_M = 0.12
"""Of what is shown: below, one would look at the tracker's noise."""

MARGIN = 1.12

SMOOTH_S = 0.1
"""In which a robot that turns on one wheel, at 3.5 rad/s, turns by 20 degrees."""


def path_plot(maneuver: str, runs: Sequence[ComparedRun]) -> str:
    """One manoeuvre's held-out repetitions as SVG; the robot starts at the dot, facing up."""
    with styled():
        figure = Figure(figsize=(3.2, 3.2), layout="constrained")
        axes: Any = figure.subplots()
        widths = {NOMINAL: 0.9, MEASURED: 0.8, CALIBRATED: 1.3}
        for path, width in widths.items():
            for run in runs:
                x, y = _smooth(run, path)
                axes.plot(-y, x, color=COLOURS[path], linewidth=width, alpha=0.8, zorder=2)
        axes.plot(0, 0, "o", color=INK, markersize=4.5, zorder=3)
        left, right, bottom, top = _window(runs)
        axes.set_xlim(left, right)
        axes.set_ylim(bottom, top)
        axes.set_aspect("equal")
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_locator(MaxNLocator(5, steps=[1, 2, 2.5, 5, 10]))
        axes.set_xlabel("to the right (m)")
        axes.set_ylabel("ahead (m)")
        return to_svg(figure, f"path-{maneuver}", f"Paths of {maneuver} from above")


def _smooth(run: ComparedRun, path: str) -> tuple[Array, Array]:
    """Means over `SMOOTH_S`: otherwise small circles vanish below the tracker's noise."""
    reach = max(1, round(SMOOTH_S / float(np.median(np.diff(run.time_s)))))
    places = run.paths()[path][:, :2]
    whole = len(places) // reach * reach
    return tuple(places[:whole].reshape(-1, reach, 2).mean(axis=1).T)  # type: ignore[return-value]


def _window(runs: Sequence[ComparedRun]) -> tuple[float, float, float, float]:
    """A square around all paths."""
    points = np.concatenate([path[:, :2] for run in runs for path in run.paths().values()])
    low, high = points.min(axis=0), points.max(axis=0)
    half = MARGIN * max(float((high - low).max()), SMALLEST_SIDE_M) / 2
    ahead, left = (low + high) / 2
    return -left - half, -left + half, ahead - half, ahead + half
