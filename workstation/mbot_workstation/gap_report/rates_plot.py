"""Steady speeds and turn rates of all manoeuvres side by side."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from mbot_workstation.gap_report.compared_run import CALIBRATED, MEASURED, NOMINAL
from mbot_workstation.gap_report.steady_rates import Rate, RunRates
from mbot_workstation.gap_report.svg import COLOURS, FAINT, NAMES, styled, to_svg

MARKERS = {NOMINAL: "D", CALIBRATED: "o", MEASURED: "|"}
SIZES = {NOMINAL: 5.0, CALIBRATED: 7.5, MEASURED: 14.0}


def rates_plot(maneuvers: Sequence[str], rates: Sequence[RunRates]) -> str:
    """As SVG; a row a manoeuvre. The measured one is a tick, with all repetitions as a bar."""
    with styled():
        figure = Figure(figsize=(8.2, 0.36 * len(maneuvers) + 1.3), layout="constrained")
        speeds, turns = figure.subplots(1, 2, sharey=True)
        _dots(speeds, maneuvers, rates, lambda rate: rate.speed_mps)
        _dots(turns, maneuvers, rates, lambda rate: np.degrees(rate.turn_radps))
        speeds.set_xlabel("steady speed (m/s), + ahead")
        turns.set_xlabel("steady turn rate (°/s), + to the left")
        speeds.set_yticks(range(len(maneuvers)), maneuvers)
        speeds.set_ylim(len(maneuvers) - 0.5, -0.5)
        figure.legend(
            *speeds.get_legend_handles_labels(),
            loc="outside upper center",
            ncols=3,
            frameon=False,
        )
        return to_svg(figure, "rates", "Steady speeds and turn rates of all manoeuvres")


def _dots(
    axes: Any, maneuvers: Sequence[str], rates: Sequence[RunRates], pick: Callable[[Rate], float]
) -> None:
    axes.axvline(0, color=FAINT, linewidth=0.8)
    for path in (NOMINAL, CALIBRATED, MEASURED):
        rows, means = [], []
        for row, maneuver in enumerate(maneuvers):
            values = [pick(one.rate(path)) for one in rates if one.maneuver == maneuver]
            if not values:
                continue
            rows.append(row)
            means.append(float(np.mean(values)))
            if path == MEASURED:
                axes.plot([min(values), max(values)], [row, row], color=COLOURS[path], linewidth=2)
        axes.plot(
            means,
            rows,
            linestyle="",
            marker=MARKERS[path],
            markersize=SIZES[path],
            markeredgewidth=2 if path == MEASURED else 0,
            color=COLOURS[path],
            label=NAMES[path],
        )
    axes.grid(axis="y", visible=False)
