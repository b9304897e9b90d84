"""motion.toml: how a robot moves. Its keys are the parameter table's: a row there is a key here."""

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
from msgspec import Struct

from mbot_protocol.drive.actions import WheelMaps
from mbot_protocol.drive.calibration import (
    MOTION_FILE,
    MotorMapping,
    MotorMappings,
    check_date,
    check_range,
    read_part,
)
from mbot_workstation.sim.body.parameter_table import (
    OF_A_MOTOR,
    OF_THE_ROBOT,
    PARAMETERS,
    Parameter,
    exactly,
)
from mbot_workstation.sim.body.robot_parameters import RobotParameters


def _keys(name: str, known: Sequence[Parameter], base: type[Struct]) -> Any:
    """A Struct to go on from, with the table's keys; None is what the robot at hand has."""
    fields = [(one.file_key, float | None, None) for one in known]
    return msgspec.defstruct(
        name, fields, bases=(base,), frozen=True, forbid_unknown_fields=True, kw_only=True
    )


def _check(part: Struct, known: Sequence[Parameter]) -> None:
    for one in known:
        if (number := getattr(part, one.file_key)) is not None:
            ends = (float(f"{one.file_factor * end:.6g}") for end in (one.low, one.high))
            check_range(one.file_key, number, *ends)


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


_MotorKeys = _keys("_MotorKeys", OF_A_MOTOR, MotorMapping)


class MotorCalibration(_MotorKeys):
    """One motor with its gear: the rows of `OF_A_MOTOR` by their `file_key`, and how the daemon
    drives it.

    Raises:
        ValueError: a value is out of its row's limits.

    """

    trim: float = 1.0
    dead_band_compensation: int = 40

    def __post_init__(self) -> None:
        super().__post_init__()
        _check(self, OF_A_MOTOR)


_RobotKeys = _keys("_RobotKeys", OF_THE_ROBOT, Struct)


class MotionCalibration(_RobotKeys):
    """motion.toml, identified from driven maneuvers: the rows of `OF_THE_ROBOT` by their
    `file_key`, and these.

    Attributes:
        left_motor, right_motor: see `MotorCalibration`.
        latency_ms: from a command's sending until the wheels' voltage changes.
        made_on: ISO date.
        intervals: of parameters, by key.
        undetermined: key -> why the recordings can't tell it.

    Raises:
        ValueError: a value is out of its row's limits.

    """

    left_motor: MotorCalibration
    right_motor: MotorCalibration
    latency_ms: float
    made_on: str
    intervals: dict[str, Interval] = msgspec.field(default_factory=dict)
    undetermined: dict[str, str] = msgspec.field(default_factory=dict)

    def __post_init__(self) -> None:
        _check(self, OF_THE_ROBOT)
        check_range("latency_ms", self.latency_ms, 0, 1000)
        check_date(self.made_on)

    def wheel_maps(self) -> WheelMaps:
        """See `MotorMappings.wheel_maps`."""
        return MotorMappings(self.left_motor, self.right_motor).wheel_maps()

    def robot(self, body: RobotParameters) -> RobotParameters:
        """The robot of this body that moves so."""
        values = {one.name: motion_value(self, one) for one in PARAMETERS}
        known = {name: number for name, number in values.items() if number is not None}
        return dataclasses.replace(exactly(body, known), wheel_maps=self.wheel_maps())


def motion_value(motion: MotionCalibration, parameter: Parameter) -> float | None:
    """A parameter of a motion.toml, in the model's unit; None if it leaves it to the body."""
    holder: object = motion
    *sections, field = parameter.file_key.split(".")
    for section in sections:
        holder = getattr(holder, section)
    number: float | None = getattr(holder, field)
    return None if number is None else number / parameter.file_factor


def read_motion(folder: Path) -> MotionCalibration | None:
    """The motion's calibration in a folder; None if it has none.

    Raises:
        ConfigurationError: there is no such folder, or the file is unusable.

    """
    return read_part(folder, MOTION_FILE, MotionCalibration)
