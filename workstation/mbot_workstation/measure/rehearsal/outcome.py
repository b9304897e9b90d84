"""What the afternoon has found out, beside the truth."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from msgspec import Struct
from rich.table import Table

from mbot_protocol.drive.actions import WheelMaps
from mbot_workstation.measure.gap_report.compare import Rate, steady_rate
from mbot_workstation.measure.identification.rollout import simulate_run
from mbot_workstation.measure.tracks.maneuver import maneuver_named
from mbot_workstation.measure.tracks.run import CommandSeries, Run
from mbot_workstation.measure.tracks.track import Track
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.calibrated.calibration_folder import CalibrationFiles

DRIVE_S = 5.0


@dataclass(frozen=True, slots=True)
class Row:
    """One quantity.

    Attributes:
        what: it is, with its unit.
        truth, nominal, found: values; `found` is None if it was not determined.
        relative: whether errors are shares of the truth.
        digits: after the point.

    """

    what: str
    truth: float
    nominal: float
    found: float | None
    relative: bool = True
    digits: int = 3

    def error(self, value: float | None) -> float | None:
        """Off the truth by this much: a share, or in the quantity's own unit."""
        if value is None:
            return None
        away = value - self.truth
        return away / self.truth if self.relative else away


def outcome(truth: CalibrationFiles, found: CalibrationFiles) -> tuple[Row, ...]:
    """All rows.

    Args:
        truth: what the virtual robot was made from.
        found: what the afternoon has written.

    """
    return (*_driving(truth, found), *_camera(truth, found), *_light(truth, found))


def as_table(rows: Sequence[Row]) -> Table:
    """For a terminal."""
    table = Table(box=None, padding=(0, 2, 0, 0))
    table.add_column("")
    for heading in ("truth", "nominal", "off by", "found", "off by"):
        table.add_column(heading, justify="right")
    for row in rows:
        found = "not told" if row.found is None else f"{row.found:z.{row.digits}f}"
        table.add_row(
            row.what,
            f"{row.truth:z.{row.digits}f}",
            f"{row.nominal:z.{row.digits}f}",
            _error_words(row, row.nominal),
            found,
            _error_words(row, row.found),
        )
    return table


class ComparedQuantity(Struct, frozen=True):
    """A row for programs; errors are shares of the truth where `relative` says so."""

    what: str
    truth: float
    nominal: float
    found: float | None
    relative: bool
    nominal_error: float | None
    found_error: float | None


def outcome_answer(rows: Sequence[Row]) -> list[ComparedQuantity]:
    """For programs."""
    return [
        ComparedQuantity(
            *(row.what, row.truth, row.nominal, row.found, row.relative),
            *(row.error(row.nominal), row.error(row.found)),
        )
        for row in rows
    ]


def _error_words(row: Row, value: float | None) -> str:
    error = row.error(value)
    if error is None:
        return ""
    return f"{100 * error:+.2f} %" if row.relative else f"{error:+.{row.digits}f}"


def _driving(truth: CalibrationFiles, found: CalibrationFiles) -> list[Row]:
    robots = truth.robot, RobotParameters(), found.robot
    straight = [_rate(robot, "forward-forward") for robot in robots]
    spin = [_rate(robot, "backward-forward") for robot in robots]
    drift = [math.degrees(rate.turn_radps) for rate in straight]
    lags = {
        side: [1000 * getattr(robot, f"{side}_motor").time_constant_s for robot in robots]
        for side in ("left", "right")
    }
    row = partial(_row, known=found.motion is not None)
    return [
        row("straight on, m/s", [rate.speed_mps for rate in straight], digits=4),
        row("drift straight on, °/s", drift, relative=False, digits=2),
        row("on the spot, °/s", [math.degrees(rate.turn_radps) for rate in spin], digits=1),
        row("track, mm", [1000 * robot.track_m for robot in robots], digits=1),
        *(row(f"{side} time constant, ms", values, digits=0) for side, values in lags.items()),
    ]


def _camera(truth: CalibrationFiles, found: CalibrationFiles) -> list[Row]:
    width = 1000  # all at one size
    models = [
        robot.camera.scaled_to(width, round(width * robot.camera.height_px / robot.camera.width_px))
        for robot in (truth.robot, RobotParameters(), found.robot)
    ]
    row = partial(_row, known=found.camera is not None, relative=False)
    return [
        row("focal length, px of 1000", [m.focal_x_px for m in models], relative=True, digits=2),
        row("axis, px from the left", [m.principal_x_px for m in models], digits=2),
        row("axis, px from the top", [m.principal_y_px for m in models], digits=2),
        row("distortion k1", [m.distortion[0] for m in models], digits=4),
        row("distortion k2", [m.distortion[1] for m in models], digits=4),
    ]


def _light(truth: CalibrationFiles, found: CalibrationFiles) -> list[Row]:
    seen = truth, CalibrationFiles(), found
    effects, lights = [files.effects for files in seen], [files.scene.light for files in seen]
    way = np.array(lights[0].direction)
    angles = [_angle_deg(way, np.array(light.direction)) for light in lights]
    row = partial(_row, known=found.light is not None)
    return [
        row("exposure", [one.exposure_gain for one in effects]),
        row("red against green", [one.red_gain for one in effects]),
        row("blue against green", [one.blue_gain for one in effects]),
        row("light from all sides", [light.ambient for light in lights]),
        row("light off its way, °", angles, relative=False, digits=1),
    ]


def _row(
    what: str, values: Sequence[float], *, known: bool, relative: bool = True, digits: int = 3
) -> Row:
    """Of the true, the nominal and the found robot's values, in that order."""
    truth, nominal, found = values
    return Row(what, truth, nominal, found if known else None, relative, digits)


def _angle_deg(one: "np.ndarray[Any, Any]", other: "np.ndarray[Any, Any]") -> float:
    cosine = one @ other / np.linalg.norm(one) / np.linalg.norm(other)
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


def _rate(robot: RobotParameters, name: str) -> Rate:
    """Steady driving of a simulated robot, exactly."""
    maneuver = maneuver_named(name)
    commands = CommandSeries(
        np.array([0.0, DRIVE_S]), np.array([maneuver.left, 0.0]), np.array([maneuver.right, 0.0])
    )
    standing = Track(np.array([0.0, 1.0]), np.zeros((2, 3)), np.array([[1.0, 0, 0, 0]] * 2))
    track = simulate_run(robot, Run(1, name, 1, commands, standing), WheelMaps())
    driven = track.time_s <= DRIVE_S
    path = np.column_stack([track.position_m[:, :2], track.yaw_rad])[driven]
    return steady_rate(track.time_s[driven], path)
