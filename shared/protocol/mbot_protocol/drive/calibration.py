"""One robot's calibration, as far as both sides read it: its camera and how it moves.

A calibration is a folder, one a robot. `workstation` writes it; simulation, training, virtual
robot and daemon read the same files. What is missing stays nominal. Here is what the daemon needs
too; the rest of motion.toml, body and light are the workstation's alone.
"""

import math
from datetime import date
from pathlib import Path
from typing import TypeVar

from msgspec import Struct

from mbot_protocol.drive.actions import LEVELS, MotorMap, WheelMaps
from mbot_protocol.drive.camera_model import CameraModel
from mbot_protocol.drive.lens import folds_in_view
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.files.toml_file import read_toml
from mbot_protocol.policy.policy_contract import FULL_VIEW

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
        check_lens(self.model())
        check_range("reprojection_error_px", self.reprojection_error_px, 0, self.width_px)
        check_range("pictures", self.pictures, 1, 100_000)
        check_date(self.made_on)

    def model(self) -> CameraModel:
        """The intrinsics to compute with."""
        names = CameraModel.__struct_fields__
        return CameraModel(**{name: getattr(self, name) for name in names})


def check_lens(camera: CameraModel) -> None:
    """Are these the intrinsics of a camera that somebody would drive with?

    Raises:
        ValueError: a value is out of its range.

    """
    check_range("width_px", camera.width_px, 16, 8192)
    check_range("height_px", camera.height_px, 16, 8192)
    for axis, size_px in (("x", camera.width_px), ("y", camera.height_px)):
        name, focal_px = f"focal_{axis}_px", getattr(camera, f"focal_{axis}_px")
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
    check_range("principal_x_px", camera.principal_x_px, 0, camera.width_px - 1)
    check_range("principal_y_px", camera.principal_y_px, 0, camera.height_px - 1)
    for value in camera.distortion:
        check_range("distortion", value, -100, 100)
    if folds_in_view(camera, FULL_VIEW):
        raise ValueError(
            f"distortion is {list(camera.distortion)}, expected a lens that does not fold "
            "over the part of its picture that a policy needs; calibrate again with the board "
            "in all of it"
        )


class MotorMapping(Struct, frozen=True):
    """How the daemon drives one motor. motion.toml's other keys are the simulation's: a file with
    one that this release does not know is read all the same.

    Attributes:
        trim, dead_band_compensation: see `MotorMap`.

    Raises:
        ValueError: a value is out of its range.

    """

    trim: float
    dead_band_compensation: int

    def __post_init__(self) -> None:
        check_range("trim", self.trim, 0.05, 1)
        check_range("dead_band_compensation", self.dead_band_compensation, 0, 200)
        if self.dead_band_compensation >= LEVELS * self.trim:
            raise ValueError(
                f"dead_band_compensation is {self.dead_band_compensation}, expected below "
                f"{LEVELS} x trim = {LEVELS * self.trim:g}"
            )

    def motor_map(self, is_reversed: bool | None = None) -> MotorMap:
        """The daemon's mapping for this motor; `is_reversed` as `MotorMap` has it."""
        return MotorMap(is_reversed, self.trim, self.dead_band_compensation)


class MotorMappings(Struct, frozen=True):
    """motion.toml as the daemon reads it."""

    left_motor: MotorMapping
    right_motor: MotorMapping

    def wheel_maps(self) -> WheelMaps:
        """What the daemon does with a policy's steps, on an mBot as it is built."""
        return WheelMaps(self.left_motor.motor_map(), self.right_motor.motor_map())


def read_camera(folder: Path) -> CameraCalibration | None:
    """The camera's calibration in a folder; None if it has none.

    Raises:
        ConfigurationError: there is no such folder, or the file is unusable.

    """
    return read_part(folder, CAMERA_FILE, CameraCalibration)


def read_motor_mappings(folder: Path) -> MotorMappings | None:
    """The daemon's part of the motion's calibration in a folder; None if it has none.

    Raises:
        ConfigurationError: there is no such folder, or the file is unusable.

    """
    return read_part(folder, MOTION_FILE, MotorMappings)


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
    """Refuse what is not an ISO date.

    Raises:
        ValueError: it is none.

    """
    try:
        date.fromisoformat(text)
    except ValueError:
        raise ValueError(f"made_on is {text!r}, expected a date such as '2026-11-21'") from None
