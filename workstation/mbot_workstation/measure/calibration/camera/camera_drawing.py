"""A camera's calibration as a picture: where the corners were, how far off, which pictures."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from mbot_workstation.measure.calibration.camera.camera_fit import CameraFit
from mbot_workstation.measure.calibration.camera.picture_sizes import scaled_corners
from mbot_workstation.pictures.picture_file import save_figure

_KEPT, _LEFT_OUT, _FAINT = "#3b6ea5", "#d9772b", "#bbbbbb"
MOST_BARS = 60
ARROW_SHARE = 0.04
"""Length of an arrow at twice the mean error, of the view's width."""


def draw_calibration(fit: CameraFit, path: Path) -> None:
    """Write the picture.

    Args:
        fit: what to show.
        path: a PNG, in a folder that exists.

    Raises:
        ConfigurationError: it can't be written.

    """
    figure = Figure(figsize=(12, 8.6), layout="constrained")
    grid = figure.add_gridspec(2, 2, height_ratios=[1.5, 1])
    _draw_coverage(figure.add_subplot(grid[0, 0]), fit)
    _draw_residuals(figure.add_subplot(grid[0, 1]), fit)
    _draw_errors(figure.add_subplot(grid[1, :]), fit)
    save_figure(figure, path)


def _draw_view(axes: Any, fit: CameraFit, title: str) -> None:
    camera = fit.camera
    axes.set_xlim(-0.5, camera.width_px - 0.5)
    axes.set_ylim(camera.height_px - 0.5, -0.5)
    axes.set_aspect("equal")
    axes.set_title(title, fontsize=11)
    for share in (1 / 3, 2 / 3):
        axes.axvline(share * camera.width_px, color=_FAINT, linewidth=0.6)
        axes.axhline(share * camera.height_px, color=_FAINT, linewidth=0.6)
    axes.plot(camera.principal_x_px, camera.principal_y_px, "k+", markersize=12)


def _draw_coverage(axes: Any, fit: CameraFit) -> None:
    left_out = len(fit.pictures) - len(fit.kept)
    _draw_view(
        axes, fit, f"corners of {len(fit.kept)} pictures, and of {left_out} left out; + is the axis"
    )
    for picture in sorted(fit.pictures, key=lambda one: one.kept):
        corners = scaled_corners(picture.sighting, fit.camera.width_px, fit.camera.height_px)
        colour = _KEPT if picture.kept else _LEFT_OUT
        axes.plot(corners[:, 0], corners[:, 1], ".", color=colour, markersize=2.5)


def _draw_residuals(axes: Any, fit: CameraFit) -> None:
    enlarged = ARROW_SHARE * fit.camera.width_px / max(2 * fit.error_px, 1e-9)
    _draw_view(axes, fit, f"how far corners are off, drawn {enlarged:.0f} times as long")
    places = [
        scaled_corners(picture.sighting, fit.camera.width_px, fit.camera.height_px)
        for picture in fit.kept
    ]
    at = np.concatenate(places)
    arrows = -np.concatenate([picture.residuals_px for picture in fit.kept]) * enlarged
    axes.quiver(
        *(at[:, 0], at[:, 1], arrows[:, 0], arrows[:, 1]),
        angles="xy",
        scale_units="xy",
        scale=1,
        width=0.0015,
        color=_KEPT,
    )


def _draw_errors(axes: Any, fit: CameraFit) -> None:
    shown = fit.pictures
    if len(shown) > MOST_BARS:
        shown = tuple(sorted(shown, key=lambda one: one.error_px)[-MOST_BARS:])
    names = [Path(picture.sighting.name).stem for picture in shown]
    errors = [picture.error_px for picture in shown]
    # An outlier may be off by a hundred times as much: the axis is for the others.
    top = max([picture.error_px for picture in fit.kept] + [fit.error_px])
    top = 1.25 * (max(top, fit.limit_px) if np.isfinite(fit.limit_px) else top)
    colours = [_KEPT if picture.kept else _LEFT_OUT for picture in shown]
    axes.bar(range(len(shown)), np.minimum(errors, top), color=colours)
    for place, error in enumerate(errors):
        if error > top:
            axes.text(place, top, f"{error:.1f}", ha="center", va="bottom", fontsize=8)
    if np.isfinite(fit.limit_px):
        axes.axhline(fit.limit_px, color="black", linewidth=0.8, linestyle="--")
        axes.text(-0.5, fit.limit_px, " limit", fontsize=9, va="bottom")
    axes.set_xticks(range(len(shown)), names, rotation=60, ha="right", fontsize=8)
    axes.set_xlim(-0.8, len(shown) - 0.2)
    axes.set_ylim(0, top * 1.12)
    axes.set_ylabel("error of a picture (px)")
    axes.set_title(f"{fit.error_px:.3f} px over all corners kept; orange: left out", fontsize=11)
    axes.spines[["top", "right"]].set_visible(False)
