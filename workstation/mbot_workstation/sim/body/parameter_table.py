"""The one table of what makes a robot move as it does: names, units, limits, priors, sources.

Whatever reads or writes a robot's motion goes through it: identification, motion.toml, training.
A motor's parameters stand once and are two, `left_` and `right_`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from mbot_workstation.sim.body.robot_parameters import RobotParameters


@dataclass(frozen=True, slots=True)
class Parameter:
    """One number of a robot.

    Attributes:
        name: its field in `RobotParameters`; of one motor, with the side in front.
        words: how a table for people calls it, with the unit.
        usual: middle of real robots; None is the robot at hand, whose body may be measured.
        spread: standard deviation among real robots, worn ones included.
        low, high: limits, as wide as makes sense.
        source: where `usual` and `spread` come from.
        file_key: its key in motion.toml.
        file_factor: from our unit to the file's.
        shown_factor: from our unit to the one in `words`.
        fixed_because: why no single run tells it; empty if the fit moves it.

    """

    name: str
    words: str
    usual: float | None
    spread: float
    low: float
    high: float
    source: str
    file_key: str
    file_factor: float = 1.0
    shown_factor: float = 1.0
    fixed_because: str = ""


OF_A_MOTOR = (
    Parameter(
        "gain", "motor gain", 1.0, 0.2, 0.05, 3.0,
        "public: 190 against 140 to go straight; the paper's handicap is 0.5", "gain",
    ),
    Parameter(
        "backward_share", "strength backward, of forward", 1.0, 0.02, 0.3, 2.0,
        "brushed motors; assumed", "backward_share",
    ),
    Parameter(
        "time_constant_s", "time constant [ms]", 0.090, 0.03, 0.006, 1.0,
        "60-120 ms, assumed", "time_constant_ms", 1000, 1000,
    ),
    Parameter(
        "dead_band", "dead band [of 255]", 50 / 255, 10 / 255, 0.0, 0.7,
        "public: starts at 40-60 of 255", "dead_band", 255, 255,
    ),
    Parameter(
        "bend", "bend of speed over duty", 1.0, 0.15, 0.3, 2.0,
        "PWM at 1 kHz on small motors: 0.7-1.1; assumed", "bend",
    ),
    Parameter(
        "dry_friction", "dry friction, of the torque at standstill", 0.15, 0.1, 0.0, 0.5,
        "what starts at a fifth of full duty has about as much", "dry_friction",
    ),
)  # fmt: skip

OF_THE_ROBOT = (
    Parameter(
        "track_m", "track [mm]", None, 0.003, 0.05, 0.4,
        "public: 115 mm, others 110; effective on another floor", "track_m", 1, 1000,
    ),
    Parameter(
        "rolling_drag_n", "rolling drag [N]", 0.15, 0.15, 0.0, 1.5,
        "a caster that bears a sixth of the weight, sliding; assumed", "rolling_drag_n",
    ),
    Parameter(
        "turning_drag_n_m", "drag in turns [N mm]", 0.01, 0.01, 0.0, 0.1,
        "the same caster 75 mm ahead; assumed", "turning_drag_n_m", 1, 1000,
    ),
    Parameter(
        "turning_knee_rad_s", "turn rate at which it is full [rad/s]", 2.5, 1.0, 0.5, 8.0,
        "caster 50-100 mm ahead, see RobotParameters", "turning_knee_rad_s",
    ),
    Parameter(
        "battery_sag", "voltage lost to both motors", 0.02, 0.02, 0.0, 0.3,
        "0.2 ohm at 0.4 A; the paper measured none", "battery_sag",
    ),
    Parameter(
        "battery_fade", "battery's fade in a session", 0.03, 0.03, 0.0, 0.5,
        "a lithium cell from full to half; assumed", "battery_fade", 1, 1,
        "it shows in how repetitions differ",
    ),
    Parameter(
        "mass_ahead_m", "centre of mass ahead [mm]", None, 0.01, -0.03, 0.06,
        "boxes against real parts; assumed", "mass_ahead_m", 1, 1000,
    ),
    Parameter(
        "inertia_scale", "moment of inertia, of the boxes'", 1.0, 0.3, 0.4, 4.0,
        "boxes against real parts; assumed", "inertia_scale",
    ),
    Parameter(
        "wheel_friction", "wheel friction", 0.9, 0.2, 0.05, 1.5,
        "handbook, rubber on vinyl: 0.7-1.0", "wheel_friction",
    ),
    Parameter(
        "wheel_radius_m", "wheel radius [mm]", None, 0.0006, 0.01, 0.1,
        "public: 30-32.5 mm", "wheel_radius_m", 1, 1000,
        "only its product with the motors' gains shows; measure it with `calibrate body`",
    ),
    Parameter(
        "free_speed_rpm", "free speed [rpm]", None, 12, 20, 600,
        "paper: 120; others 105-132", "free_speed_rpm", 1, 1,
        "only its product with the motors' gains shows",
    ),
    Parameter(
        "load_loss", "loss under load", None, 0.02, 0.0, 0.5,
        "assumed; the paper has no figure", "load_loss", 1, 1,
        "only its product with the motors' gains shows",
    ),
)  # fmt: skip

SIDES = ("left", "right")

PARAMETERS: tuple[Parameter, ...] = (
    *(
        replace(one, name=f"{side}_{one.name}", words=f"{side} {one.words}",
                file_key=f"{side}_motor.{one.file_key}")
        for one in OF_A_MOTOR
        for side in SIDES
    ),
    *OF_THE_ROBOT,
)  # fmt: skip

BY_NAME = {parameter.name: parameter for parameter in PARAMETERS}
NAMES = tuple(BY_NAME)
TOLD_BY_DRIVING = tuple(one.name for one in PARAMETERS if not one.fixed_because)

_OF_A_MOTOR = {one.name for one in OF_A_MOTOR}


def value(robot: RobotParameters, name: str) -> float:
    """A parameter of a robot, in the model's unit."""
    side, _, field = name.partition("_")
    if side in SIDES and field in _OF_A_MOTOR:
        return float(getattr(getattr(robot, f"{side}_motor"), field))
    if name == "mass_ahead_m":
        return robot.centre_of_mass_m
    return float(getattr(robot, name))


def usual(robot: RobotParameters, name: str) -> float:
    """The middle of what real robots have: the table's, or this robot's as far as it is known."""
    middle = BY_NAME[name].usual
    return value(robot, name) if middle is None else middle


def with_values(robot: RobotParameters, values: Mapping[str, float]) -> RobotParameters:
    """The robot with other values, in the model's units, each brought inside its limits."""
    limited = {
        name: min(max(float(wanted), BY_NAME[name].low), BY_NAME[name].high)
        for name, wanted in values.items()
    }
    return exactly(robot, limited)


def exactly(robot: RobotParameters, values: Mapping[str, float]) -> RobotParameters:
    """The robot with these values, in the model's units."""
    motors = {"left": robot.left_motor, "right": robot.right_motor}
    others: dict[str, float] = {}
    for name, number in values.items():
        side, _, field = name.partition("_")
        if side in SIDES and field in _OF_A_MOTOR:
            motors[side] = replace(motors[side], **{field: number})
        else:
            others[name] = number
    return replace(robot, left_motor=motors["left"], right_motor=motors["right"], **others)
