"""The action pipeline: two numbers in [-1, 1] -> 501 motor steps -> the board's speeds.

Simulation, export and robot all call these functions, so they cannot drift apart.
"""

import math
from dataclasses import dataclass

from mbot_protocol.drive.mcore import SPEED_LIMIT, Joystick

STEP_LIMIT = 250
"""The paper's robot has 501 steps: 250 backward, one for 0 V, 250 forward."""


@dataclass(frozen=True, slots=True)
class Steps:
    """A command in the paper's units: each wheel in -250..250, positive is forward.

    Raises:
        ValueError: a step is not a whole number in -250..250.

    """

    left: int
    right: int

    def __post_init__(self) -> None:
        for name, step in (("left", self.left), ("right", self.right)):
            if type(step) is not int or not -STEP_LIMIT <= step <= STEP_LIMIT:
                raise ValueError(
                    f"{name} is {step!r}, expected a whole number in -{STEP_LIMIT}..{STEP_LIMIT}"
                )

    @property
    def action(self) -> tuple[float, float]:
        """Left and right in [-1, 1]: what the wheels were really told of a policy's action."""
        return self.left / STEP_LIMIT, self.right / STEP_LIMIT


STANDSTILL = Steps(0, 0)


@dataclass(frozen=True, slots=True)
class MotorMap:
    """How one wheel's steps become the board's speed.

    Attributes:
        reversed: whether forward is a negative board speed.
        trim: share of the range this motor may use, in (0, 1]; the stronger motor gets less.
        dead_band: the largest board speed, of 255, at which the wheel still stands; step 1
            starts just above it. Public notes say 40 to 60; 0 passes steps on unshifted.

    """

    reversed: bool
    trim: float = 1.0
    dead_band: int = 40

    def __post_init__(self) -> None:
        if not 0.0 < self.trim <= 1.0:
            raise ValueError(f"trim is {self.trim!r}, expected a number in (0, 1]")
        if not 0 <= self.dead_band < SPEED_LIMIT * self.trim:
            raise ValueError(
                f"dead_band is {self.dead_band!r}, expected a whole number from 0 to "
                f"{SPEED_LIMIT} x trim"
            )

    def to_board(self, step: int) -> int:
        """The board's speed in -255..255 for a step in -250..250.

        0 stays 0; the sign follows `reversed`; 250 becomes 255 x trim; in between it is linear
        from the dead band upwards, so that equal steps are equal changes of voltage that works.
        """
        if step == 0:
            return 0
        usable = SPEED_LIMIT * self.trim - self.dead_band
        speed = round(self.dead_band + usable * abs(step) / STEP_LIMIT)
        return -speed if (step > 0) == self.reversed else speed


@dataclass(frozen=True, slots=True)
class WheelMaps:
    """Both wheels of a robot. Nominal: M1 is the left wheel and runs backwards (measured)."""

    left: MotorMap = MotorMap(reversed=True)
    right: MotorMap = MotorMap(reversed=False)

    def to_board(self, steps: Steps) -> Joystick:
        """The board command for these steps."""
        return Joystick(m1=self.left.to_board(steps.left), m2=self.right.to_board(steps.right))


def to_steps(left: float, right: float) -> Steps:
    """The nearest of the 501 steps for a policy's action.

    Args:
        left: left wheel, clipped to [-1, 1]; 1 is full speed forward.
        right: right wheel, likewise.

    Raises:
        ValueError: a value is NaN or infinite; such an action must never reach a motor.

    """
    if not (math.isfinite(left) and math.isfinite(right)):
        raise ValueError(f"action is ({left}, {right}), expected two finite numbers")
    return Steps(_to_step(left), _to_step(right))


def _to_step(value: float) -> int:
    return round(max(-1.0, min(1.0, value)) * STEP_LIMIT)
