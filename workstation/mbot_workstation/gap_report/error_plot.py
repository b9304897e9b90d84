"""Errors of position and heading over time, calibrated and nominal, across repetitions."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from mbot_workstation.gap_report.compared_run import CALIBRATED, NOMINAL
from mbot_workstation.gap_report.path_error import Band, PathError
from mbot_workstation.gap_report.svg import COLOURS, styled, to_svg
from mbot_workstation.recordings.track import Array

LEAST_M, MOST_M = 1e-3, 10.0
LEAST_DEG, MOST_DEG = 0.1, 1000.0
"""All plots reach as far, so that they can be compared; logarithmic, since a nominal robot is some
hundred times further off than a calibrated one."""


def error_plot(maneuver: str, calibrated: PathError, nominal: PathError) -> str:
    """One manoeuvre as SVG: lines are medians, bands reach over all repetitions."""
    with styled():
        figure = Figure(figsize=(3.2, 3.5), layout="constrained")
        upper, lower = figure.subplots(2, 1, sharex=True)
        for path, error in ((NOMINAL, nominal), (CALIBRATED, calibrated)):
            _band(upper, error.time_s, error.position_m, path, 1.0, LEAST_M)
            _band(lower, error.time_s, error.yaw_rad, path, np.degrees(1.0), LEAST_DEG)
        _axis(upper, "position off by", LEAST_M, MOST_M, _metres)
        _axis(lower, "heading off by", LEAST_DEG, MOST_DEG, lambda value: f"{value:g}°")
        lower.set_xlabel("time since the first command (s)")
        lower.set_xlim(0, float(calibrated.time_s[-1]))
        return to_svg(figure, f"error-{maneuver}", f"Errors of {maneuver} over time")


def _band(axes: Any, time_s: Array, band: Band, path: str, factor: float, least: float) -> None:
    low, middle, high = (
        np.maximum(factor * values, least / 10) for values in (band.low, band.middle, band.high)
    )
    colour = COLOURS[path]
    axes.fill_between(time_s, low, high, color=colour, alpha=0.2, linewidth=0)
    axes.plot(time_s, middle, color=colour, linewidth=1.6)


def _axis(axes: Any, label: str, least: float, most: float, words: Any) -> None:
    axes.set_yscale("log")
    axes.set_ylim(least, most)
    decades = [10.0**power for power in range(round(np.log10(least)), round(np.log10(most)) + 1)]
    axes.yaxis.set_major_locator(FixedLocator(decades))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _place: words(value)))
    axes.set_ylabel(label)


def _metres(value: float) -> str:
    for unit, size in (("m", 1.0), ("cm", 0.01), ("mm", 0.001)):
        if value >= 0.999 * size:
            return f"{value / size:.0f} {unit}"
    return f"{value:g} m"
