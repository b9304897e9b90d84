"""Measured and simulated paths over each other, from above."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from mbot_workstation.gap_report.compared_run import CALIBRATED, MEASURED, NOMINAL, ComparedRun
from mbot_workstation.gap_report.svg import COLOURS, INK, styled, to_svg

SMALLEST_SIDE_M = 0.12
"""Of what is shown: below, one would look at the tracker's noise."""

MARGIN = 1.12

EVERY = 2
"""Of the compared moments, 0.02 s apart: a robot on one wheel turns by 8 degrees in between."""


def path_plot(maneuver: str, runs: Sequence[ComparedRun]) -> str:
    """One manoeuvre's held-out repetitions as SVG; the robot starts at the dot, facing up."""
    with styled():
        figure = Figure(figsize=(3.2, 3.2), layout="constrained")
        axes: Any = figure.subplots()
        widths = {NOMINAL: 0.9, MEASURED: 0.8, CALIBRATED: 1.3}
        for path, width in widths.items():
            for run in runs:
                x, y, _yaw = run.paths()[path][::EVERY].T
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


def _window(runs: Sequence[ComparedRun]) -> tuple[float, float, float, float]:
    """A square around all paths."""
    points = np.concatenate([path[:, :2] for run in runs for path in run.paths().values()])
    low, high = points.min(axis=0), points.max(axis=0)
    half = MARGIN * max(float((high - low).max()), SMALLEST_SIDE_M) / 2
    ahead, left = (low + high) / 2
    return -left - half, -left + half, ahead - half, ahead + half
