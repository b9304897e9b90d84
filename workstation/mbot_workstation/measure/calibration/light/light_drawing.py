"""The gray card, real and simulated, side by side; and where the light comes from."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from mbot_workstation.measure.calibration.light.light_measurement import LightMeasurement
from mbot_workstation.pictures.picture_file import save_figure

_LIT, _FAINT = "#d9772b", "#bbbbbb"
MOST_ROWS = 16


def draw_light(measured: LightMeasurement, path: Path) -> None:
    """Write the picture.

    Raises:
        ConfigurationError: it can't be written.

    """
    shown = min(MOST_ROWS, len(measured.readings))
    figure = Figure(figsize=(10.5, max(3.6, 1.2 + 0.42 * shown)), layout="constrained")
    grid = figure.add_gridspec(1, 2, width_ratios=[1.5, 1])
    _draw_cards(figure.add_subplot(grid[0, 0]), measured, shown)
    _draw_direction(figure.add_subplot(grid[0, 1]), measured)
    save_figure(figure, path)


def _draw_cards(axes: Any, measured: LightMeasurement, shown: int) -> None:
    real = np.array([reading.rgb for reading in measured.readings])
    swatches = np.stack([measured.before, real, measured.after, real], axis=1)[:shown] / 255
    axes.imshow(swatches, aspect="auto", interpolation="nearest", extent=(0, 4, shown, 0))
    for row in range(shown):
        for column, difference in (
            (0.5, measured.differences_before[row]),
            (2.5, measured.differences_after[row]),
        ):
            dark = swatches[row, int(column)].mean() < 0.5
            axes.text(
                *(column, row + 0.5, f"{difference:.1f}"),
                color="white" if dark else "black",
                ha="center",
                va="center",
                fontsize=8,
            )
    axes.axvline(2, color="white", linewidth=6)
    axes.set_xticks(
        [0.5, 1.5, 2.5, 3.5], ["nominal\nsimulation", "real", "calibrated\nsimulation", "real"]
    )
    axes.set_yticks(
        np.arange(shown) + 0.5,
        [Path(reading.name).stem for reading in measured.readings[:shown]],
        fontsize=8,
    )
    axes.set_title("gray card, with its difference from the real one (CIEDE2000)", fontsize=10)
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)


def _draw_direction(axes: Any, measured: LightMeasurement) -> None:
    """From above: the robot in the middle heading up, cards' facings, and the light."""
    axes.set_aspect("equal")
    for height_deg in (0, 30, 60):
        radius = np.cos(np.radians(height_deg))
        around = np.linspace(0, 2 * np.pi, 90)
        axes.plot(radius * np.cos(around), radius * np.sin(around), color=_FAINT, linewidth=0.7)
        axes.text(0, -radius, f"{height_deg}°", fontsize=7, color="grey", ha="center", va="top")
    for normal in measured.normals:
        if normal is not None:
            axes.plot(-normal[1], normal[0], "o", color="grey", markersize=4)
    light = measured.fit.light
    towards = -np.array(light.direction) / np.linalg.norm(light.direction)
    axes.plot(-towards[1], towards[0], "*", color=_LIT, markersize=16)
    axes.arrow(0, 0, 0, 0.12, width=0.02, color="black")
    fitted = measured.fit.undetermined is None
    axes.set_title(
        "from above, the robot heads up\nstar: where the light comes from, "
        f"{'fitted' if fitted else 'nominal'}\n"
        f"dots: facings of the card; {100 * light.ambient:.0f} % ambient",
        fontsize=9,
    )
    axes.set_xlim(-1.15, 1.15)
    axes.set_ylim(-1.2, 1.15)
    axes.axis("off")
