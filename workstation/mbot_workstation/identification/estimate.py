"""What identification found: values with intervals, errors before and after, what was left out."""

from dataclasses import dataclass

from mbot_workstation.identification.scatter import Scatter
from mbot_workstation.simulation.robot_parameters import RobotParameters


@dataclass(frozen=True, slots=True)
class Estimate:
    """One parameter.

    Attributes:
        name: see `parameters.Parameter`.
        value: used from now on, in the model's unit.
        before: what it was.
        low, high: 95 % interval, None if it was not determined.
        why_not: why the recordings can't tell it; None if they can.

    """

    name: str
    value: float
    before: float
    low: float | None = None
    high: float | None = None
    why_not: str | None = None


@dataclass(frozen=True, slots=True)
class RunError:
    """How far a held-out run's simulation ends from where the robot was.

    Attributes:
        name: of the run, for people.
        maneuver: its name.
        at_s: after the first command.
        before_m, after_m: distance of the axle's centre, with the parameters before and after.
        before_rad, after_rad: of the heading, whole turns counted.
        turned_rad: by which angle the robot had turned, positive to the left.

    """

    name: str
    maneuver: str
    at_s: float
    before_m: float
    after_m: float
    before_rad: float
    after_rad: float
    turned_rad: float


@dataclass(frozen=True, slots=True)
class Repeatability:
    """How far repetitions of a manoeuvre end from their mean (root mean square): no model of this
    robot can be better.
    """

    maneuver: str
    place_m: float
    heading_rad: float


@dataclass(frozen=True, slots=True)
class Identification:
    """The result.

    Attributes:
        robot_id: whose.
        before, robot: its parameters before and after.
        estimates: of all parameters, in the order of `PARAMETERS`.
        latency: from command to wheel [s]; undetermined unless the clocks were one.
        clock_drift: of each recording's tracker against the robot's clock.
        tracker: of each recording: ahead [m], to the left [m], turned to the left [rad].
        singular_values: of the scaled Jacobian, largest first.
        scatter: of the runs about the simulation.
        errors: of the held-out runs.
        repeatability: of each manoeuvre.
        fitted: how many runs were fitted.
        left_out: runs that were not used, and why.

    """

    robot_id: str
    before: RobotParameters
    robot: RobotParameters
    estimates: tuple[Estimate, ...]
    latency: Estimate
    clock_drift: tuple[float, ...]
    tracker: tuple[tuple[float, float, float], ...]
    singular_values: tuple[float, ...]
    scatter: Scatter
    errors: tuple[RunError, ...]
    repeatability: tuple[Repeatability, ...]
    fitted: int
    left_out: dict[str, str]

    @property
    def is_worse(self) -> bool:
        """Whether the held-out runs are further off than before, in place and in heading."""
        place = sum(error.after_m - error.before_m for error in self.errors)
        heading = sum(error.after_rad - error.before_rad for error in self.errors)
        return place > 0 and heading > 0
