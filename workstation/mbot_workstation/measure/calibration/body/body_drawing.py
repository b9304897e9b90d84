"""The robot from the side, from above and from the front, to scale, to hold against the real one.

An A4 sheet; a usual mBot fits on it at 1 : 2.5. The grid counts in centimetres.
"""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from mbot_workstation.measure.calibration.body.body_views import (
    CAMERA,
    CENTRE,
    FRONT,
    REACH,
    SIDE,
    TOP,
    WHEEL,
    WHEEL_WIDTH_M,
    draw_view,
)
from mbot_workstation.measure.calibration.body.mass_properties import MassProperties
from mbot_workstation.pictures.picture_file import save_figure
from mbot_workstation.sim.body.robot_mjcf import CASTER_RADIUS_M
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.calibrated.body_calibration import BodyCalibration

SHEET_MM = (297.0, 210.0)
MM_PER_INCH = 25.4
DOTS_PER_INCH = 150
MARGIN_M = 0.02
GAP_MM = 16.0
PLUS_MINUS = "\N{PLUS-MINUS SIGN}"


def draw_body(
    body: BodyCalibration, robot: RobotParameters, whole: MassProperties, path: Path
) -> None:
    """Write the drawing.

    Args:
        body: the components.
        robot: wheels, caster and camera.
        whole: the centre of mass.
        path: a file matplotlib can write: PNG, PDF or SVG.

    Raises:
        ConfigurationError: it can't be written.

    """
    low, high = _extent(body, robot)
    size_mm = (high - low) * 1000
    scale = _scale(size_mm)
    figure = Figure(figsize=(SHEET_MM[0] / MM_PER_INCH, SHEET_MM[1] / MM_PER_INCH))
    x_mm, y_mm, z_mm = size_mm * scale
    left_mm, top_mm = 18.0, SHEET_MM[1] - 24.0
    places = (
        (SIDE, left_mm, top_mm - z_mm),
        (FRONT, left_mm + x_mm + GAP_MM + 4, top_mm - z_mm),
        (TOP, left_mm, top_mm - z_mm - GAP_MM - y_mm),
    )
    for view, across_mm, up_mm in places:
        size = size_mm[[view.across, view.up]] * scale
        axes: Any = figure.add_axes(
            (
                across_mm / SHEET_MM[0],
                up_mm / SHEET_MM[1],
                size[0] / SHEET_MM[0],
                size[1] / SHEET_MM[1],
            )
        )
        draw_view(axes, view, body, robot, whole)
        axes.set_xlim(low[view.across] * 1000, high[view.across] * 1000)
        axes.set_ylim(low[view.up] * 1000, high[view.up] * 1000)
    table_mm = left_mm + x_mm + GAP_MM + 4
    _write_table(figure, body, robot, whole, table_mm, top_mm - z_mm - GAP_MM - 4)
    figure.text(
        left_mm / SHEET_MM[0],
        1 - 11 / SHEET_MM[1],
        f"The robot's body, {_ratio(scale)} when printed at 100 % on A4; grid 10 mm",
        fontsize=11,
        fontweight="bold",
    )
    save_figure(figure, path, DOTS_PER_INCH)


def _extent(body: BodyCalibration, robot: RobotParameters) -> tuple[np.ndarray, np.ndarray]:
    corners = [
        np.array(part.centre_m) + s * np.array(part.size_m) / 2
        for part in body.components
        for s in (-1, 1)
    ]
    reach, half_track = robot.touch_radius_m, robot.track_m / 2 + WHEEL_WIDTH_M / 2
    corners += [np.array([-reach, -max(reach, half_track), 0.0])]
    corners += [np.array([reach, max(reach, half_track), 2 * robot.wheel_radius_m])]
    corners += [np.array([robot.caster_ahead_m + CASTER_RADIUS_M, 0.0, 0.0])]
    corners += [np.array([robot.camera_mount.ahead_m, 0.0, robot.camera_mount.height_m])]
    low, high = np.min(corners, axis=0) - MARGIN_M, np.max(corners, axis=0) + MARGIN_M
    low[2] = -0.008  # the floor needs no margin
    return low, high


def _scale(size_mm: np.ndarray) -> float:
    """The largest of the usual scales at which the views and the table fit on the sheet."""
    for scale in (1.0, 0.5, 0.4, 1 / 3, 0.25, 0.2, 0.1):
        wide_mm = (size_mm[0] + size_mm[1]) * scale + 2 * GAP_MM + 24
        high_mm = (size_mm[2] + size_mm[1]) * scale + GAP_MM + 44
        if wide_mm <= SHEET_MM[0] and high_mm <= SHEET_MM[1]:
            return scale
    return 0.05


def _ratio(scale: float) -> str:
    return f"1 : {1 / scale:g}" if scale < 1 else "full size"


def _write_table(
    figure: Figure,
    body: BodyCalibration,
    robot: RobotParameters,
    whole: MassProperties,
    left_mm: float,
    top_mm: float,
) -> None:
    step_mm = min(5.0, (top_mm - 12) / (len(body.components) + 9))
    lines: list[tuple[str, str, str, str]] = [("", "component", "mass, g", "size x, y, z, mm")]
    for number, part in enumerate(body.components, start=1):
        size = " x ".join(f"{edge * 1000:.3g}" for edge in part.size_m)
        lines.append((str(number), part.name, _mass(part.mass_kg, part.mass_uncertainty_kg), size))
    wheel = _mass(robot.wheel_mass_kg, body.wheel_mass_uncertainty_kg)
    across = f"radius {robot.wheel_radius_m * 1000:.4g}, track {robot.track_m * 1000:.4g}"
    lines.append(("", "two wheels, each", wheel, across))
    lines.append(("", "the whole robot", _mass(whole.mass_kg, whole.mass_uncertainty_kg), ""))
    for row, line in enumerate(lines):
        weight = "bold" if row in (0, len(lines) - 1) else "normal"
        for text, offset_mm, align in zip(line, (4, 7, 78, 82), ("right", "left") * 2, strict=True):
            at_mm = left_mm + offset_mm, top_mm - row * step_mm
            _write(figure, at_mm, text, ha=align, fontweight=weight)
    legend = _legend(robot, whole)
    for row, (colour, text) in enumerate(legend, start=len(lines) + 1):
        _write(figure, (left_mm + 2, top_mm - row * step_mm), text, color=colour)


def _write(figure: Figure, at_mm: tuple[float, float], text: str, **style: Any) -> None:
    x, y = at_mm
    figure.text(x / SHEET_MM[0], y / SHEET_MM[1], text, va="center", fontsize=8, **style)


def _legend(robot: RobotParameters, whole: MassProperties) -> tuple[tuple[str, str], ...]:
    """Lines with their colours."""
    places = zip("xyz", whole.centre_m * 1000, whole.centre_uncertainty_m * 1000, strict=True)
    centre = ", ".join(f"{axis} {at:z.1f} {PLUS_MINUS} {off:.1f}" for axis, at, off in places)
    mount, dot = robot.camera_mount, "\N{MIDDLE DOT}"
    return (
        (CENTRE, f"+  centre of mass: {centre} mm (95 %)"),
        (
            CAMERA,
            f"\N{BULLET}  camera: {mount.height_m * 1000:.4g} mm high, "
            f"{mount.ahead_m * 1000:.4g} ahead, {mount.pitch_down_deg:g} degrees down",
        ),
        (WHEEL, f"- -  caster, {robot.caster_ahead_m * 1000:.4g} mm ahead of the axle"),
        (REACH, f"{dot} {dot}  touches within {robot.touch_radius_m * 1000:.4g} mm"),
    )


def _mass(mass_kg: float, uncertainty_kg: float) -> str:
    return f"{mass_kg * 1000:.4g} {PLUS_MINUS} {uncertainty_kg * 1000:.2g}"
