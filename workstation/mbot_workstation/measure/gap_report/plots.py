"""The page's charts: SVG, each as an address that holds the whole picture."""

import base64
from collections.abc import Callable, Mapping, Sequence
from io import BytesIO
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator, NullLocator

from mbot_workstation.learn.studies.tolerance_file import MapAxis, RewardMap, Tolerances
from mbot_workstation.measure.gap_report.compare import (
    CALIBRATED,
    MEASURED,
    NOMINAL,
    PATHS,
    ComparedRun,
    Rate,
)
from mbot_workstation.measure.gap_report.figures import path_error
from mbot_workstation.measure.gap_report.quantities import Quantity
from mbot_workstation.measure.tracks.track import Array

COLOURS = {MEASURED: "#1c1c1e", CALIBRATED: "#2f6fb2", NOMINAL: "#d9772b"}
"""Dark for what is real, blue for the calibrated simulation, orange for the nominal one; the style
sheet has them too."""

NAMES = {MEASURED: "measured", CALIBRATED: "simulated", NOMINAL: "nominal simulation"}
GRID, INK, FAINT = "#e4e4e7", "#3f3f46", "#a1a1aa"

_STYLE: dict[Any, Any] = {
    "svg.fonttype": "path",  # looks the same wherever it is opened
    "svg.hashsalt": "gap-report",  # the same data makes the same file
    "path.simplify_threshold": 0.3,
    "font.size": 9,
    "axes.edgecolor": FAINT,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": GRID,
    "grid.linewidth": 0.7,
    "legend.frameon": False,
    **dict.fromkeys(("axes.spines.top", "axes.spines.right"), False),
    **dict.fromkeys(("text.color", "axes.labelcolor", "xtick.color", "ytick.color"), INK),
    **dict.fromkeys(("xtick.labelsize", "ytick.labelsize"), 8),
}

SMALLEST_SIDE_M = 0.12
"""Of what a path's plot shows: below, one would look at the tracker's noise."""

EVERY = 2
"""Of the compared moments, 0.02 s apart: a robot on one wheel turns by 8 degrees in between."""

POSITION, HEADING = (1e-3, 10.0), (0.1, 1000.0)
"""Metres and degrees. All plots reach as far, so that they can be compared; logarithmic, since a
nominal robot is some hundred times further off than a calibrated one."""


def to_uri(figure: Figure) -> str:
    """The figure as the address of an HTML picture."""
    buffer = BytesIO()
    figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None})
    return f"data:image/svg+xml;base64,{base64.b64encode(buffer.getvalue()).decode()}"


@mpl.rc_context(_STYLE)
def path_plot(runs: Sequence[ComparedRun]) -> str:
    """One maneuver's repetitions from above; the robot starts at the dot, facing up."""
    figure = Figure(figsize=(3.2, 3.2), layout="constrained")
    axes: Any = figure.subplots()
    for path, width in ((NOMINAL, 0.9), (MEASURED, 0.8), (CALIBRATED, 1.3)):
        for run in runs:
            x, y, _yaw = getattr(run, path)[::EVERY].T
            axes.plot(-y, x, color=COLOURS[path], linewidth=width, alpha=0.8, zorder=2)
    axes.plot(0, 0, "o", color=INK, markersize=4.5, zorder=3)
    points = np.concatenate([getattr(run, path)[:, :2] for run in runs for path in PATHS])
    (ahead, left), sides = (points.min(axis=0) + points.max(axis=0)) / 2, np.ptp(points, axis=0)
    half = 0.56 * max(float(sides.max()), SMALLEST_SIDE_M)
    axes.set(xlim=(-left - half, -left + half), ylim=(ahead - half, ahead + half), aspect="equal")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(5, steps=[1, 2, 2.5, 5, 10]))
    axes.set(xlabel="to the right (m)", ylabel="ahead (m)")
    return to_uri(figure)


@mpl.rc_context(_STYLE)
def error_plot(runs: Sequence[ComparedRun]) -> str:
    """One maneuver's errors over time: lines are medians, bands reach over all repetitions."""
    figure = Figure(figsize=(3.2, 3.5), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    for path in (NOMINAL, CALIBRATED):
        error = path_error(runs, path)
        _band(upper, error.time_s, error.position_m, path, POSITION[0])
        _band(lower, error.time_s, np.degrees(error.yaw_rad), path, HEADING[0])
    _decades(upper, "position off by", POSITION, _metres)
    _decades(lower, "heading off by", HEADING, lambda value: f"{value:g}°")
    lower.set(xlabel="time since the first command (s)", xlim=(0, float(error.time_s[-1])))
    return to_uri(figure)


def _band(axes: Any, time_s: Array, rows: Array, path: str, least: float) -> None:
    rows = np.maximum(rows, least / 10)
    colour = COLOURS[path]
    axes.fill_between(time_s, rows.min(0), rows.max(0), color=colour, alpha=0.2, linewidth=0)
    axes.plot(time_s, np.median(rows, axis=0), color=colour, linewidth=1.6)


def _decades(
    axes: Any, label: str, ends: tuple[float, float], words: Callable[[float], str]
) -> None:
    first, last = np.log10(ends).round().astype(int)
    axes.set(yscale="log", ylim=ends, ylabel=label)
    axes.yaxis.set_major_locator(FixedLocator(10.0 ** np.arange(first, last + 1)))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _place: words(value)))


def _metres(value: float) -> str:
    for unit, size in (("m", 1.0), ("cm", 0.01)):
        if value >= 0.999 * size:
            return f"{value / size:.0f} {unit}"
    return f"{1000 * value:g} mm"


@mpl.rc_context(_STYLE)
def rates_plot(maneuvers: Mapping[str, Sequence[ComparedRun]]) -> str:
    """Steady speeds and turn rates, a row a maneuver."""
    figure = Figure(figsize=(8.2, 0.36 * len(maneuvers) + 1.3), layout="constrained")
    speeds, turns = figure.subplots(1, 2, sharey=True)
    _dots(speeds, maneuvers, lambda rate: rate.speed_mps)
    _dots(turns, maneuvers, lambda rate: float(np.degrees(rate.turn_radps)))
    speeds.set_xlabel("steady speed (m/s), + ahead")
    turns.set_xlabel("steady turn rate (°/s), + to the left")
    speeds.set_yticks(range(len(maneuvers)), maneuvers)
    speeds.set_ylim(max(len(maneuvers), 1) - 0.5, -0.5)
    figure.legend(*speeds.get_legend_handles_labels(), loc="outside upper center", ncols=4)
    return to_uri(figure)


def _dots(
    axes: Any, maneuvers: Mapping[str, Sequence[ComparedRun]], pick: Callable[[Rate], float]
) -> None:
    axes.axvline(0, color=FAINT, linewidth=0.8)
    axes.grid(axis="y", visible=False)
    steady = {
        row: some
        for row, runs in enumerate(maneuvers.values())
        if (some := [run for run in runs if run.is_steady])
    }
    for path, marker, size in ((NOMINAL, "D", 5.0), (CALIBRATED, "o", 7.5), (MEASURED, "|", 14.0)):
        values = [[pick(run.rate(path)) for run in runs] for runs in steady.values()]
        style = {"color": COLOURS[path], "markeredgewidth": 2 if path == MEASURED else 0}
        means = [float(np.mean(some)) for some in values]
        axes.plot(means, list(steady), marker, markersize=size, label=NAMES[path], **style)
        if path == MEASURED:
            low, high = [min(some) for some in values], [max(some) for some in values]
            axes.hlines(list(steady), low, high, color=INK, linewidth=2, label="all repetitions")


@mpl.rc_context(_STYLE)
def tolerance_plot(one: RewardMap, tolerances: Tolerances, known: Mapping[str, Quantity]) -> str:
    """One tolerance map with this robot on it; green is tolerated, the line is its border.

    Args:
        one: the map.
        tolerances: what it is a part of.
        known: quantities by the name of their axis.

    """
    figure = Figure(figsize=(4.0, 3.4), layout="constrained")
    axes: Any = figure.subplots()
    both = one.across, one.up
    x, y = (_shown(axis, axis.values, known) for axis in both)
    shares = 100 * np.array(one.rewards) / tolerances.nominal_reward
    border = 100 * tolerances.tolerated_share
    levels = np.linspace(0, 100, 21)
    filled = axes.contourf(x, y, shares.clip(0, 100), levels=levels, cmap="YlGn", vmax=150)
    if shares.min() < border < shares.max():
        axes.contour(x, y, shares, levels=[border], colors="#14532d", linewidths=1.8)
    for field, path, words in (
        ("uncalibrated", NOMINAL, "trained on the nominal robot"),
        ("calibrated", CALIBRATED, "trained on the calibration"),
    ):
        values = [getattr(known.get(axis.name), field, None) for axis in both]
        if values != [None, None]:  # one alone is shown where the other one is nominal
            at = [
                np.clip(axis.nominal if value is None else value, axis.values[0], axis.values[-1])
                for axis, value in zip(both, values, strict=True)
            ]
            place = [_shown(axis, [one], known) for axis, one in zip(both, at, strict=True)]
            style = {"color": COLOURS[path], "markeredgecolor": "white", "markersize": 9}
            axes.plot(*place, "o", label=words, clip_on=False, zorder=5, **style)
    axes.set(xlabel=axis_words(one.across, known), ylabel=axis_words(one.up, known))
    axes.grid(visible=False)
    figure.colorbar(filled, ax=axes, label="reward left (%)", ticks=[0, 25, 50, 75, 100])
    handles = axes.get_legend_handles_labels()
    figure.legend(*handles, loc="outside upper center", ncols=2, fontsize=7.5)
    return to_uri(figure)


def axis_words(axis: MapAxis, known: Mapping[str, Quantity]) -> str:
    """What a map's axis counts, such as "Track off by (%)"."""
    quantity = known.get(axis.name)
    if quantity is None:
        return f"{axis.name.replace('_ms', ' time').replace('_', ' ').capitalize()} ({axis.unit})"
    return f"{quantity.title} off by ({quantity.unit})"


def _shown(axis: MapAxis, values: Sequence[float], known: Mapping[str, Quantity]) -> Array:
    quantity = known.get(axis.name)
    return np.array([v if quantity is None else quantity.shown(v) for v in values])
