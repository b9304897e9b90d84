"""What identification found: values with intervals, what the model misses, what was left out."""

from dataclasses import dataclass

from mbot_workstation.measure.identification.exclusion import Exclusion
from mbot_workstation.measure.identification.solver import VarianceComponents
from mbot_workstation.sim.body.robot_parameters import RobotParameters


@dataclass(frozen=True, slots=True)
class ParameterEstimate:
    """One parameter.

    Attributes:
        name: see `simulation.parameter_table`.
        value: used from now on, in the model's unit.
        before: what it was.
        low, high: 95 % interval, None if it can't be told.
        why_not: why the recordings can't tell it; None if they can.

    """

    name: str
    value: float
    before: float
    low: float | None = None
    high: float | None = None
    why_not: str | None = None


@dataclass(frozen=True, slots=True)
class SteadyRate:
    """How the identified robot drives a maneuver once it is at speed, with a fresh battery.

    Attributes:
        maneuver: its name.
        speed_m_s: forward.
        turn_rad_s: positive to the left.
        speed_sd, turn_sd: how far a drive may be off: what the fit does not know, what the model
            misses, and how repetitions differ.

    """

    maneuver: str
    speed_m_s: float
    turn_rad_s: float
    speed_sd: float
    turn_sd: float


@dataclass(frozen=True, slots=True)
class Misfit:
    """What the model gets wrong in all runs of a maneuver, as shares of its faster wheel's speed.

    Attributes:
        maneuver: its name.
        left, right: speed of the real wheel beyond the simulated one's.
        sideways: likewise of the whole robot, to the left.

    """

    maneuver: str
    left: float
    right: float
    sideways: float

    @property
    def size(self) -> float:
        """The larger one of both wheels."""
        return max(abs(self.left), abs(self.right))


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
    """How far repetitions of a maneuver end from their mean (root mean square): no model of this
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
        before, robot: its parameters before and after, with a fresh battery.
        estimates: of all parameters, in the order of the table.
        latency: from command to wheel [s]; undetermined unless the clocks were one.
        clock_drift: of each recording's tracker against the robot's clock.
        tracker: of each recording: ahead [m], to the left [m], turned to the left [rad].
        variances: of the runs about the simulation.
        misfits: of each maneuver.
        steady: predicted, of each maneuver that was driven at one command.
        errors: of the runs that were held out when half of them were fitted.
        repeatability: of each maneuver.
        fitted: how many runs were fitted in the end: all that can be used.
        excluded: runs that were not used, by name.

    """

    robot_id: str
    before: RobotParameters
    robot: RobotParameters
    estimates: tuple[ParameterEstimate, ...]
    latency: ParameterEstimate
    clock_drift: tuple[float, ...]
    tracker: tuple[tuple[float, float, float], ...]
    variances: VarianceComponents
    misfits: tuple[Misfit, ...]
    steady: tuple[SteadyRate, ...]
    errors: tuple[RunError, ...]
    repeatability: tuple[Repeatability, ...]
    fitted: int
    excluded: dict[str, Exclusion]

    @property
    def is_worse(self) -> bool:
        """Whether the held-out runs are further off than before, in place and in heading."""
        place = sum(error.after_m - error.before_m for error in self.errors)
        heading = sum(error.after_rad - error.before_rad for error in self.errors)
        return place > 0 and heading > 0
