"""One view of a robot's body: its boxes, wheels, caster, camera and centre of mass, in mm."""

import math
from collections import defaultdict
from typing import Any, NamedTuple

import numpy as np
from matplotlib.colors import to_rgb
from matplotlib.patches import Circle, Ellipse, Rectangle
from matplotlib.ticker import MultipleLocator

from mbot_workstation.measure.calibration.body.mass_properties import MassProperties
from mbot_workstation.sim.body.robot_mjcf import CASTER_RADIUS_M
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.calibrated.body_calibration import (
    UNKNOWN_COLOUR,
    BodyCalibration,
    Component,
)

WHEEL_WIDTH_M = 0.018
"""As the simulation draws it."""

NUMBER_APART_M = 0.014
"""Between the middles of two numbers, at half scale 5.5 mm on paper."""

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


SIDE = BodyView("from its right side", 0, 2, (1, -1), ("x, ahead of the axle, mm", "z, mm"))
TOP = BodyView("from above", 0, 1, (2, 1), ("x, ahead of the axle, mm", "y, to the left, mm"))
FRONT = BodyView("from the front", 1, 2, (0, 1), ("y, to its left, mm", "z, mm"))


def draw_view(
    axes: Any, view: BodyView, body: BodyCalibration, robot: RobotParameters, whole: MassProperties
) -> None:
    """Draw it.

    Args:
        axes: matplotlib's; its limits are set by the caller, in mm.
        view: which.
        body: the components, numbered in their order from 1.
        robot: wheels, caster and camera.
        whole: the centre of mass.

    """
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
    behind_first = sorted(
        enumerate(body.components, start=1), key=lambda item: sign * item[1].centre_m[axis]
    )
    for number, part in behind_first:
        colour = PALETTE[number % len(PALETTE)]
        if part.colour_rgb != UNKNOWN_COLOUR:
            colour = part.colour_rgb
        across, up = _span(part, view.across), _span(part, view.up)
        axes.add_patch(
            Rectangle(
                (across[0], up[0]),
                across[1] - across[0],
                up[1] - up[0],
                facecolor=(*colour, 0.35),
                edgecolor=(*colour, 1),
                linewidth=1.1,
            )
        )
    _draw_camera(axes, view, robot)
    if view is not TOP:
        axes.axhline(0, color="black", linewidth=1.2)
    _number(axes, view, body)
    place, spread = (whole.centre_m * 1000, whole.centre_uncertainty_m * 1000)
    axes.add_patch(
        Ellipse(
            (place[view.across], place[view.up]),
            2 * spread[view.across],
            2 * spread[view.up],
            facecolor=(0.76, 0.07, 0.12, 0.25),
            edgecolor=CENTRE,
            linewidth=1,
            zorder=6,
        )
    )
    axes.plot(place[view.across], place[view.up], "+", color=CENTRE, markersize=9, zorder=7)


def _draw_wheels(axes: Any, view: BodyView, robot: RobotParameters) -> None:
    radius, track = robot.wheel_radius_m * 1000, robot.track_m * 1000
    width = WHEEL_WIDTH_M * 1000
    style: dict[str, Any] = {"facecolor": "#00000018", "edgecolor": WHEEL, "linewidth": 1.1}
    if view is SIDE:
        axes.add_patch(Circle((0, radius), radius, **style))
        axes.plot(0, radius, ".", color=WHEEL, markersize=4)
    for side in (1, -1) if view is not SIDE else ():
        middle = side * track / 2 - width / 2
        corner, size = ((-radius, middle), (2 * radius, width))
        if view is FRONT:
            corner, size = (middle, 0.0), (width, 2 * radius)
        axes.add_patch(Rectangle(corner, *size, **style))
    caster, ball = robot.caster_ahead_m * 1000, CASTER_RADIUS_M * 1000
    place = {SIDE: (caster, ball), TOP: (caster, 0.0), FRONT: (0.0, ball)}[view]
    axes.add_patch(Circle(place, ball, facecolor="none", edgecolor=WHEEL, linestyle="--"))
    if view is TOP:
        reach = robot.touch_radius_m * 1000
        axes.add_patch(Circle((0, 0), reach, facecolor="none", edgecolor=REACH, linestyle=":"))
        axes.plot([0, 0], [-track / 2, track / 2], color=WHEEL, linewidth=0.8)


def _draw_camera(axes: Any, view: BodyView, robot: RobotParameters) -> None:
    """The lens, and the edges of what it sees, 50 mm far."""
    mount, camera = robot.camera_mount, robot.camera
    place = np.array([mount.ahead_m, mount.left_m, mount.height_m]) * 1000
    axes.plot(place[view.across], place[view.up], "o", color=CAMERA, markersize=4, zorder=6)
    if view is FRONT:
        return
    if view is SIDE:
        heading, half = -mount.pitch_down_deg, camera.height_px / 2 / camera.focal_y_px
    else:
        heading, half = mount.yaw_left_deg, camera.width_px / 2 / camera.focal_x_px
    for edge_deg in (-math.degrees(math.atan(half)), 0.0, math.degrees(math.atan(half))):
        angle = math.radians(heading + edge_deg)
        axes.plot(
            [place[view.across], place[view.across] + 50 * math.cos(angle)],
            [place[view.up], place[view.up] + 50 * math.sin(angle)],
            color=CAMERA,
            linewidth=0.9,
            linestyle="-." if edge_deg == 0 else "-",
            zorder=5,
        )


def _number(axes: Any, view: BodyView, body: BodyCalibration) -> None:
    """The components' numbers in their boxes; those that lie behind each other share a place."""
    sharing: defaultdict[tuple[float, ...], list[int]] = defaultdict(list)
    for number, part in enumerate(body.components, start=1):
        sharing[(*_span(part, view.across), *_span(part, view.up))].append(number)
    boxes = np.array(list(sharing)).reshape(-1, 2, 2)
    for place, numbers in zip(_apart(boxes), sharing.values(), strict=True):
        axes.text(
            *place,
            ", ".join(map(str, numbers)),
            ha="center",
            va="center",
            fontsize=7,
            zorder=8,
            bbox={
                "boxstyle": "circle,pad=0.15",
                "facecolor": "white",
                "edgecolor": "#444444",
                "linewidth": 0.6,
            },
        )


def _apart(boxes: np.ndarray) -> np.ndarray:
    """A place in each box, as far from the others' as need be; (n, 2, 2) spans to (n, 2)."""
    places = boxes.mean(axis=2)
    rng = np.random.default_rng(0)
    places = places + rng.normal(scale=0.1, size=places.shape)  # what coincides must part somehow
    least = NUMBER_APART_M * 1000
    for _ in range(200):
        for one in range(len(places)):
            for other in range(one):
                between = places[one] - places[other]
                distance = float(np.hypot(*between))
                if distance < least:
                    push = between / max(distance, 1e-6) * (least - distance) / 2
                    places[one] += push
                    places[other] -= push
        places = np.clip(places, boxes[:, :, 0], boxes[:, :, 1])
    return places


def _span(part: Component, axis: int) -> tuple[float, float]:
    """From where to where it reaches, in mm."""
    middle, half = part.centre_m[axis] * 1000, part.size_m[axis] * 500
    return middle - half, middle + half
