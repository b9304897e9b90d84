"""What may be identified: every parameter with its place in the robot, its usual spread, limits."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from mbot_workstation.simulation.robot_parameters import RobotParameters


@dataclass(frozen=True, slots=True)
class Parameter:
    """One number of the robot.

    Attributes:
        name: its field in `RobotParameters`; of a motor, the field with the side in front; a field
            of both motors has no side.
        words: how a table calls it, with the unit.
        spread: standard deviation among real units, with which everything is scaled: what the
            recordings don't know better than a third of it, they don't know.
        low, high: limits, as wide as makes sense.
        factor: from the model's unit to the table's.
        step_share: finite differences take this share of the spread: so little that a path of
            65 rad stays linear in it, or parameters would seem to differ that are one. Friction
            needs more: it works by beginning and ending to slip.

    """

    name: str
    words: str
    spread: float
    low: float
    high: float
    factor: float = 1.0
    step_share: float = 0.001


def _sided(field: str, words: str, *numbers: float) -> tuple[Parameter, ...]:
    return tuple(
        Parameter(f"{side}_{field}", f"{side} {words}", *numbers) for side in ("left", "right")
    )


PARAMETERS: tuple[Parameter, ...] = (
    *_sided("gain", "motor gain", 0.05, 0.1, 2.5),
    *_sided("time_constant_s", "time constant [ms]", 0.03, 0.006, 1.0, 1000),
    Parameter("track_m", "track [mm]", 0.003, 0.05, 0.4, 1000),
    *_sided("dead_band", "dead band [of 255]", 10 / 255, 0.0, 0.7, 255),
    *_sided("backward_share", "strength backward, of forward", 0.03, 0.3, 2.0),
    Parameter("turning_drag_n_m", "drag in turns [N mm]", 0.01, 0.0, 0.1, 1000, 0.02),
    Parameter("mass_ahead_m", "centre of mass ahead [mm]", 0.01, -0.03, 0.06, 1000),
    Parameter("inertia_scale", "moment of inertia", 0.3, 0.4, 4.0),
    Parameter("dry_friction", "dry friction", 0.1, 0.0, 0.4, step_share=0.2),
    Parameter("wheel_friction", "wheel friction", 0.2, 0.05, 1.5, step_share=0.02),
    Parameter("wheel_radius_m", "wheel radius [mm]", 0.0006, 0.01, 0.1, 1000),
    Parameter("free_speed_rpm", "free speed [rpm]", 12, 20, 600),
    Parameter("load_loss", "loss under load", 0.02, 0.0, 0.5),
)
"""In the order in which they are taken in as long as the recordings can tell them from those
before. Spreads: simulation/robot_parameters.py, where it gives one."""

NAMES = tuple(parameter.name for parameter in PARAMETERS)
BY_NAME = {parameter.name: parameter for parameter in PARAMETERS}

_OF_MOTORS = {"gain", "backward_share", "dead_band", "time_constant_s"}
_OF_BOTH_MOTORS = {"dry_friction"}


def value(robot: RobotParameters, name: str) -> float:
    """A parameter of a robot, in the model's unit."""
    side, _, field = name.partition("_")
    if field in _OF_MOTORS:
        return float(getattr(getattr(robot, f"{side}_motor"), field))
    if name in _OF_BOTH_MOTORS:
        return (getattr(robot.left_motor, name) + getattr(robot.right_motor, name)) / 2
    if name == "mass_ahead_m":
        return robot.centre_of_mass_m
    return float(getattr(robot, name))


def with_values(robot: RobotParameters, values: Mapping[str, float]) -> RobotParameters:
    """The robot with other values, in the model's units, each brought inside its limits."""
    motors = {"left": robot.left_motor, "right": robot.right_motor}
    others: dict[str, float] = {}
    for name, wanted in values.items():
        limits = BY_NAME[name]
        number = min(max(float(wanted), limits.low), limits.high)
        side, _, field = name.partition("_")
        if field in _OF_MOTORS:
            motors[side] = replace(motors[side], **{field: number})
        elif name in _OF_BOTH_MOTORS:
            motors = {s: replace(motor, **{name: number}) for s, motor in motors.items()}
        else:
            others[name] = number
    return replace(robot, left_motor=motors["left"], right_motor=motors["right"], **others)
