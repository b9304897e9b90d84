"""The robot from the side, from above and from the front, to scale, to hold against the real one.

An A4 sheet; a usual mBot fits on it at 1 : 2.5. The grid counts in centimetres.
"""

import math
from collections import defaultdict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Ellipse, Rectangle
from matplotlib.ticker import MultipleLocator

from mbot_workstation.measure.calibration.body.mass_properties import MassProperties
from mbot_workstation.pictures.picture_file import save_figure
from mbot_workstation.sim.body.robot_mjcf import CASTER_RADIUS_M
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.calibrated.body_calibration import UNKNOWN_COLOUR, BodyCalibration

SHEET_MM = (297.0, 210.0)
MM_PER_INCH = 25.4
DOTS_PER_INCH = 150
MARGIN_M = 0.02
GAP_MM = 16.0
PLUS_MINUS = "\N{PLUS-MINUS SIGN}"

WHEEL_WIDTH_M = 0.018
"""As the simulation draws it."""

NUMBER_APART_MM = 14.0
"""Between the middles of two numbers, at half scale 5.5 mm on paper."""

RAY_MM = 50.0
"""Of the edges of the camera's view, as drawn."""

PALETTE = [to_rgb(f"C{number}") for number in range(10)]
"""For components without a colour."""

CENTRE, CAMERA, WHEEL, REACH = "#c1121f", "#1d4ed8", "#333333", "#888888"


class BodyView(NamedTuple):
    """One of the three.

    Attributes:
        title: its heading.
        across, up: which of x, y, z lie along the sheet.
        towards: which one points at the reader, and with which sign.
        labels: of the axes.

    """

    title: str
    across: int
    up: int
    towards: tuple[int, int]
    labels: tuple[str, str]

    def place(self, point_mm: np.ndarray) -> tuple[float, float]:
        """A point of the robot, shape (3,), on the sheet."""
        return float(point_mm[self.across]), float(point_mm[self.up])

    def box(self, centre_mm: np.ndarray, size_mm: np.ndarray, **style: Any) -> Rectangle:
        """A box along the axes; shapes (3,)."""
        size = self.place(size_mm)
        return Rectangle(self.place(centre_mm - size_mm / 2), *size, linewidth=1.1, **style)


SIDE = BodyView("from its right side", 0, 2, (1, -1), ("x, ahead of the axle, mm", "z, mm"))
TOP = BodyView("from above", 0, 1, (2, 1), ("x, ahead of the axle, mm", "y, to the left, mm"))
FRONT = BodyView("from the front", 1, 2, (0, 1), ("y, to its left, mm", "z, mm"))


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
        corner, extent = np.array([across_mm, up_mm]) / SHEET_MM, size / SHEET_MM
        axes: Any = figure.add_axes((*corner, *extent))
        _draw_view(axes, view, body, robot, whole)
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


def _draw_view(
    axes: Any, view: BodyView, body: BodyCalibration, robot: RobotParameters, whole: MassProperties
) -> None:
    """Components numbered from 1, wheels, caster, camera and centre of mass, in mm."""
    axes.set_title(view.title, fontsize=9, pad=3)
    for axis, label in ((axes.xaxis, view.labels[0]), (axes.yaxis, view.labels[1])):
        axis.set_major_locator(MultipleLocator(50))
        axis.set_minor_locator(MultipleLocator(10))
        axis.set_label_text(label, fontsize=7)
    axes.tick_params(labelsize=7, pad=1)
    axes.grid(which="major", color="#bbbbbb", linewidth=0.6)
    axes.grid(which="minor", color="#e4e4e4", linewidth=0.4)
    axes.set_axisbelow(True)
    _draw_wheels(axes, view, robot)
    axis, sign = view.towards
    boxes = [1000 * np.array([part.centre_m, part.size_m]) for part in body.components]
    for index in sorted(range(len(boxes)), key=lambda one: sign * boxes[one][0, axis]):
        known = body.components[index].colour_rgb
        colour = PALETTE[(index + 1) % len(PALETTE)] if known == UNKNOWN_COLOUR else known
        axes.add_patch(view.box(*boxes[index], facecolor=(*colour, 0.35), edgecolor=(*colour, 1.0)))
    _draw_camera(axes, view, robot)
    if view is not TOP:
        axes.axhline(0, color="black", linewidth=1.2)
    _number(axes, view, boxes)
    place, spread = view.place(whole.centre_m * 1000), view.place(whole.centre_uncertainty_m * 2000)
    axes.add_patch(Ellipse(place, *spread, facecolor=(*to_rgb(CENTRE), 0.25), edgecolor=CENTRE))
    axes.plot(*place, "+", color=CENTRE, markersize=9, zorder=7)


def _draw_wheels(axes: Any, view: BodyView, robot: RobotParameters) -> None:
    radius, track = robot.wheel_radius_m * 1000, robot.track_m * 1000
    width, ball = WHEEL_WIDTH_M * 1000, CASTER_RADIUS_M * 1000
    style: dict[str, Any] = {"facecolor": "#00000018", "edgecolor": WHEEL}
    if view is SIDE:
        axes.add_patch(Circle((0, radius), radius, linewidth=1.1, **style))
        axes.plot(0, radius, ".", color=WHEEL, markersize=4)
    else:
        size = np.array([2 * radius, width, 2 * radius])
        for side in (1, -1):
            axes.add_patch(view.box(np.array([0, side * track / 2, radius]), size, **style))
    caster = view.place(np.array([robot.caster_ahead_m * 1000, 0.0, ball]))
    axes.add_patch(Circle(caster, ball, facecolor="none", edgecolor=WHEEL, linestyle="--"))
    if view is TOP:
        reach = robot.touch_radius_m * 1000
        axes.add_patch(Circle((0, 0), reach, facecolor="none", edgecolor=REACH, linestyle=":"))
        axes.plot([0, 0], [-track / 2, track / 2], color=WHEEL, linewidth=0.8)


def _draw_camera(axes: Any, view: BodyView, robot: RobotParameters) -> None:
    """The lens, and the edges of what it sees."""
    mount, camera = robot.camera_mount, robot.camera
    x, y = view.place(1000 * np.array([mount.ahead_m, mount.left_m, mount.height_m]))
    axes.plot(x, y, "o", color=CAMERA, markersize=4, zorder=6)
    if view is FRONT:
        return
    heading_deg, half = mount.yaw_left_deg, camera.width_px / 2 / camera.focal_x_px
    if view is SIDE:
        heading_deg, half = -mount.pitch_down_deg, camera.height_px / 2 / camera.focal_y_px
    for edge, line in ((-math.atan(half), "-"), (0.0, "-."), (math.atan(half), "-")):
        angle = math.radians(heading_deg) + edge
        ends = [x, x + RAY_MM * math.cos(angle)], [y, y + RAY_MM * math.sin(angle)]
        axes.plot(*ends, color=CAMERA, linewidth=0.9, linestyle=line, zorder=5)


def _number(axes: Any, view: BodyView, boxes: list[np.ndarray]) -> None:
    """The components' numbers in their boxes; those that lie behind each other share a place."""
    sharing: defaultdict[tuple[float, ...], list[int]] = defaultdict(list)
    for number, (centre_mm, size_mm) in enumerate(boxes, start=1):
        sharing[(*view.place(centre_mm), *view.place(size_mm))].append(number)
    rows = np.array(list(sharing))
    frame = {"boxstyle": "circle,pad=0.15", "facecolor": "white", "edgecolor": "#444444"}
    style = {"ha": "center", "va": "center", "fontsize": 7, "zorder": 8}
    for place, numbers in zip(_apart(rows[:, :2], rows[:, 2:]), sharing.values(), strict=True):
        axes.text(*place, ", ".join(map(str, numbers)), bbox=frame | {"linewidth": 0.6}, **style)


def _apart(middles: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """A place in each box, as far from the others' as need be. All of shape (n, 2)."""
    rng = np.random.default_rng(0)
    places = middles + rng.normal(scale=0.1, size=middles.shape)  # what coincides must part somehow
    for _ in range(200):
        for one in range(len(places)):
            for other in range(one):
                between = places[one] - places[other]
                distance = float(np.hypot(*between))
                if distance < NUMBER_APART_MM:
                    push = between / max(distance, 1e-6) * (NUMBER_APART_MM - distance) / 2
                    places[one] += push
                    places[other] -= push
        places = np.clip(places, middles - sizes / 2, middles + sizes / 2)
    return places


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
