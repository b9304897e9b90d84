"""Tolerance maps with this robot on them: without its calibration, and with it."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from mbot_workstation.gap_report.compared_run import CALIBRATED, NOMINAL
from mbot_workstation.gap_report.quantity import Quantity
from mbot_workstation.gap_report.svg import COLOURS, styled, to_svg
from mbot_workstation.training.studies.tolerance_file import MapAxis, RewardMap, Tolerances


def tolerance_plot(
    number: int, one: RewardMap, tolerances: Tolerances, known: Mapping[str, Quantity]
) -> str:
    """One map as SVG; green is borne, the line is its border.

    Args:
        number: of the map, for ids.
        one: the map.
        tolerances: what it is a part of.
        known: quantities by the name of their axis.

    """
    across, up = one.across, one.up
    shares = 100 * np.array(one.rewards) / tolerances.nominal_reward
    border = 100 * tolerances.bearable_share
    with styled():
        figure = Figure(figsize=(4.0, 3.4), layout="constrained")
        axes: Any = figure.subplots()
        levels = np.linspace(0, 100, 21)
        filled = axes.contourf(
            across.values, up.values, shares.clip(0, 100), levels=levels, cmap="YlGn", vmax=150
        )
        if shares.min() < border < shares.max():
            axes.contour(
                across.values, up.values, shares, levels=[border], colors="#14532d", linewidths=1.8
            )
        places = (
            ("uncalibrated", "o", COLOURS[NOMINAL], "trained on the nominal robot"),
            ("calibrated", "o", COLOURS[CALIBRATED], "trained on the calibration"),
        )
        for field, marker, colour, words in places:
            x, y = _value(known, across, field), _value(known, up, field)
            axes.plot(
                np.clip(x, across.values[0], across.values[-1]),
                np.clip(y, up.values[0], up.values[-1]),
                marker,
                color=colour,
                markeredgecolor="white",
                markersize=9,
                label=words,
                clip_on=False,
                zorder=5,
            )
        axes.set_xlabel(_label(across))
        axes.set_ylabel(_label(up))
        axes.grid(visible=False)
        figure.colorbar(filled, ax=axes, label="reward left (%)", ticks=[0, 25, 50, 75, 100])
        figure.legend(
            *axes.get_legend_handles_labels(),
            loc="outside upper center",
            ncols=2,
            frameon=False,
            fontsize=7.5,
        )
        return to_svg(figure, f"map-{number}", f"Tolerance of {across.name} and {up.name}")


def _label(axis: MapAxis) -> str:
    name = axis.name.removesuffix("_ms").removesuffix("_deg").replace("_", " ")
    return f"{name} ({axis.unit})"


def _value(known: Mapping[str, Quantity], axis: MapAxis, field: str) -> float:
    """The robot's place on an axis; nominal where it is not known."""
    quantity = known.get(axis.name)
    value = None if quantity is None else getattr(quantity, field)
    return axis.nominal if value is None else float(value)
