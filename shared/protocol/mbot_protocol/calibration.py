"""One robot's calibration, as far as both sides read it: its camera and how it moves.

A calibration is a folder, one a robot. `workstation` writes it; simulation, training, virtual
robot and daemon read the same files. What is missing stays nominal. Here are the two files the
daemon needs too; body and light are `mbot_workstation.calibration`'s.
"""

import math
from datetime import date
from pathlib import Path
from typing import TypeVar

from msgspec import Struct

from mbot_protocol.actions import MotorMap, WheelMaps
from mbot_protocol.camera_model import CameraModel
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.lens import folds_in_view
from mbot_protocol.mcore import SPEED_LIMIT
from mbot_protocol.policy_contract import FULL_VIEW
from mbot_protocol.toml_file import read_toml

T = TypeVar("T")

CAMERA_FILE = "camera.toml"
MOTION_FILE = "motion.toml"

NARROWEST_FOV_DEG, WIDEST_FOV_DEG = 10.0, 150.0
"""Of a camera somebody would drive with; a focal length in millimetres is far outside."""


class CameraCalibration(Struct, frozen=True, forbid_unknown_fields=True):
    """camera.toml: the camera's intrinsics, at the resolution they were measured at.

    Attributes:
        width_px, height_px: of the photographs.
        focal_x_px, focal_y_px, principal_x_px, principal_y_px, distortion: see `CameraModel`.
        reprojection_error_px: root mean square over all corners that were kept.
        pictures: how many were kept.
        made_on: ISO date.

    Raises:
        ValueError: a value is out of its range.

    """

    width_px: int
    height_px: int
    focal_x_px: float
    focal_y_px: float
    principal_x_px: float
    principal_y_px: float
    distortion: tuple[float, ...]
    reprojection_error_px: float
    pictures: int
    made_on: str

    def __post_init__(self) -> None:
        check_range("width_px", self.width_px, 16, 8192)
        check_range("height_px", self.height_px, 16, 8192)
        for axis, size_px in (("x", self.width_px), ("y", self.height_px)):
            name, focal_px = f"focal_{axis}_px", getattr(self, f"focal_{axis}_px")
            most, least = (
                size_px / 2 / math.tan(math.radians(fov_deg) / 2)
                for fov_deg in (NARROWEST_FOV_DEG, WIDEST_FOV_DEG)
            )
            if not least <= focal_px <= most:
                raise ValueError(
                    f"{name} is {focal_px}, expected {least:.0f} to {most:.0f} at {size_px} pixels "
                    f"({WIDEST_FOV_DEG:g} to {NARROWEST_FOV_DEG:g} degrees of view); it counts in "
                    "pixels, not in millimetres"
                )
        check_range("principal_x_px", self.principal_x_px, 0, self.width_px - 1)
        check_range("principal_y_px", self.principal_y_px, 0, self.height_px - 1)
        for value in self.distortion:
            check_range("distortion", value, -100, 100)
        check_range("reprojection_error_px", self.reprojection_error_px, 0, self.width_px)
        check_range("pictures", self.pictures, 1, 100_000)
        check_date(self.made_on)
        if folds_in_view(self.model(), FULL_VIEW):
            raise ValueError(
                f"distortion is {list(self.distortion)}, expected a lens that does not fold "
                "over the part of its picture that a policy needs; calibrate again with the board "
                "in all of it"
            )

    def model(self) -> CameraModel:
        """The intrinsics to compute with."""
        return CameraModel(
            width_px=self.width_px,
            height_px=self.height_px,
            focal_x_px=self.focal_x_px,
            focal_y_px=self.focal_y_px,
            principal_x_px=self.principal_x_px,
            principal_y_px=self.principal_y_px,
            distortion=self.distortion,
        )


class MotorCalibration(Struct, frozen=True, forbid_unknown_fields=True):
    """One motor with its gear, and how the daemon drives it.

    Attributes:
        gain: strength against the nominal motor.
        dead_band: the board speed, of 255, up to which the wheel stands.
        time_constant_ms: of the wheel's speed after a step.
        bend: exponent of the duty beyond the dead band.
        backward_share: strength when it turns the wheel backward, against forward.
        dry_friction: share of the nominal motor's torque at standstill that holds the wheel.
        trim, dead_band_compensation: the daemon's `MotorMap` for this motor.

    Raises:
        ValueError: a value is out of its range.

    """

    gain: float
    dead_band: float
    time_constant_ms: float
    bend: float = 1.0
    dry_friction: float = 0.0
    backward_share: float = 1.0
    trim: float = 1.0
    dead_band_compensation: int = 40

    def __post_init__(self) -> None:
        check_range("gain", self.gain, 0.05, 3)
        check_range("backward_share", self.backward_share, 0.2, 3)
        check_range("dead_band", self.dead_band, 0, 200)
        check_range("bend", self.bend, 0.2, 3)
        check_range("time_constant_ms", self.time_constant_ms, 5, 2000)
        check_range("dry_friction", self.dry_friction, 0, 0.9)
        check_range("trim", self.trim, 0.05, 1)
        check_range("dead_band_compensation", self.dead_band_compensation, 0, 200)
        if self.dead_band_compensation >= SPEED_LIMIT * self.trim:
            raise ValueError(
                f"dead_band_compensation is {self.dead_band_compensation}, expected below "
                f"{SPEED_LIMIT} x trim = {SPEED_LIMIT * self.trim:g}"
            )

    def motor_map(self, *, is_reversed: bool) -> MotorMap:
        """The daemon's mapping for this motor."""
        return MotorMap(is_reversed, self.trim, self.dead_band_compensation)


class Interval(Struct, frozen=True, forbid_unknown_fields=True):
    """Where a value lies with 95 % confidence.

    Raises:
        ValueError: its ends are not finite or in the wrong order.

    """

    low: float
    high: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.low) and math.isfinite(self.high) and self.low <= self.high):
            raise ValueError(f"low, high are {self.low}, {self.high}, expected low <= high")


class MotionCalibration(Struct, frozen=True, forbid_unknown_fields=True):
    """motion.toml: motors and wheels, identified from driven manoeuvres.

    Attributes:
        left_motor, right_motor: see `MotorCalibration`.
        free_speed_rpm: of a wheel with gain 1 at full duty, without load.
        wheel_radius_m: effective.
        track_m: between the wheels' centres, effective.
        wheel_friction: of the wheels on the floor, sliding.
        load_loss: share of the free speed lost under the robot's own load.
        rolling_drag_n: force with which caster and bearings resist driving.
        turning_drag_n_m: torque with which caster and tyres resist a turn.
        turning_knee_rad_s: turn rate from which on they do so in full.
        battery_sag: share of the voltage lost while both motors drive at full duty.
        battery_fade: share of their strength that a session takes from a fresh battery.
        mass_ahead_m: the robot's centre of mass ahead of the axle; None is what its body makes.
        inertia_scale: its moments of inertia against what its body makes.
        latency_ms: from a command's sending until the wheels' voltage changes.
        made_on: ISO date.
        intervals: of parameters, by name.
        undetermined: parameter -> why the recordings can't tell it.

    Raises:
        ValueError: a value is out of its range.

    """

    left_motor: MotorCalibration
    right_motor: MotorCalibration
    free_speed_rpm: float
    wheel_radius_m: float
    track_m: float
    wheel_friction: float
    load_loss: float
    latency_ms: float
    made_on: str
    mass_ahead_m: float | None = None
    inertia_scale: float = 1.0
    rolling_drag_n: float = 0.0
    turning_drag_n_m: float = 0.0
    turning_knee_rad_s: float = 2.5
    battery_sag: float = 0.0
    battery_fade: float = 0.0
    intervals: dict[str, Interval] = {}
    undetermined: dict[str, str] = {}

    def __post_init__(self) -> None:
        check_range("free_speed_rpm", self.free_speed_rpm, 10, 1000)
        check_range("wheel_radius_m", self.wheel_radius_m, 0.005, 0.15)
        check_range("track_m", self.track_m, 0.03, 0.6)
        check_range("wheel_friction", self.wheel_friction, 0.02, 3)
        check_range("load_loss", self.load_loss, 0, 0.9)
        check_range("latency_ms", self.latency_ms, 0, 1000)
        if self.mass_ahead_m is not None:
            check_range("mass_ahead_m", self.mass_ahead_m, -0.05, 0.1)
        check_range("inertia_scale", self.inertia_scale, 0.2, 5)
        check_range("rolling_drag_n", self.rolling_drag_n, 0, 10)
        check_range("turning_drag_n_m", self.turning_drag_n_m, 0, 1)
        check_range("turning_knee_rad_s", self.turning_knee_rad_s, 0.1, 20)
        check_range("battery_sag", self.battery_sag, 0, 0.9)
        check_range("battery_fade", self.battery_fade, 0, 0.9)
        check_date(self.made_on)

    def wheel_maps(self) -> WheelMaps:
        """What the daemon does with a policy's steps. M1 is on the left and runs backwards."""
        return WheelMaps(
            left=self.left_motor.motor_map(is_reversed=True),
            right=self.right_motor.motor_map(is_reversed=False),
        )


def read_camera(folder: Path) -> CameraCalibration | None:
    """The camera's calibration in a folder; None if it has none.

    Raises:
        ConfigurationError: there is no such folder, or the file is unusable.

    """
    return read_part(folder, CAMERA_FILE, CameraCalibration)


def read_motion(folder: Path) -> MotionCalibration | None:
    """The motion's calibration in a folder; None if it has none.

    Raises:
        ConfigurationError: there is no such folder, or the file is unusable.

    """
    return read_part(folder, MOTION_FILE, MotionCalibration)


def read_part(folder: Path, name: str, kind: type[T]) -> T | None:
    """One file of a calibration folder; None if it is not there.

    Raises:
        ConfigurationError: there is no such folder, or the file is unusable.

    """
    path = folder / name
    try:
        if not folder.is_dir():
            raise ConfigurationError(
                f"no calibration folder {folder}: `workstation calibrate` and `identify` write one"
            )
        is_there = path.exists()
    except OSError as error:
        raise ConfigurationError(f"can't look into {folder}: {error.strerror}") from None
    return read_toml(path, kind) if is_there else None


def check_range(name: str, value: float, least: float, most: float) -> None:
    """Refuse a value that can't be.

    Raises:
        ValueError: it is not finite, or outside of least to most.

    """
    if not least <= value <= most:  # also false for NaN
        raise ValueError(f"{name} is {value}, expected {least:g} to {most:g}")


def check_date(text: str) -> None:
    """Refuse what is no ISO date.

    Raises:
        ValueError: it is none.

    """
    try:
        date.fromisoformat(text)
    except ValueError:
        raise ValueError(f"made_on is {text!r}, expected a date such as '2026-11-21'") from None
