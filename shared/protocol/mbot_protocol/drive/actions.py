"""The action pipeline: two numbers in [-1, 1] -> 501 motor steps -> the wheels' duties.

Simulation, export and robot all call these functions, so they cannot drift apart.
"""

import math
from dataclasses import dataclass
from typing import Annotated

from msgspec import Meta, Struct, structs

from mbot_protocol.drive.wheel_command import Duties

STEP_LIMIT = 250
"""The paper's robot has 501 steps: 250 backward, one for 0 V, 250 forward."""

LEVELS = 255
"""Of a duty: as fine as the 8 bits of a board's PWM tell apart. Dead bands count in them."""


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


class MotorMap(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """How one wheel's steps become the duty of its motor.

    Attributes:
        reversed: whether the wheel rolls forward when its motor runs backward; None: as its side
            is built, see `WheelMaps`.
        trim: share of the range this motor may use, in (0, 1]; the stronger motor gets less.
        dead_band: the largest duty, in 255ths, at which the wheel still stands; step 1 starts just
            above it. Public notes say 40 to 60; 0 passes steps on unshifted.

    Raises:
        ValueError: nothing of the range is left above the dead band.

    """

    reversed: bool | None = None
    trim: Annotated[float, Meta(gt=0, le=1)] = 1.0
    dead_band: Annotated[int, Meta(ge=0, le=200)] = 40

    def __post_init__(self) -> None:
        if not 0.0 < self.trim <= 1.0:
            raise ValueError(f"trim is {self.trim!r}, expected a number in (0, 1]")
        if not 0 <= self.dead_band < LEVELS * self.trim:
            raise ValueError(
                f"dead_band is {self.dead_band!r}, expected a whole number from 0 to "
                f"{LEVELS} x trim"
            )

    def duty(self, step: int) -> float:
        """The wheel's duty in [-1, 1], a whole number of 255ths, for a step in -250..250.

        0 stays 0; 250 becomes the trim; in between it is linear from the dead band upwards, so
        that equal steps are equal changes of voltage that works.
        """
        if step == 0:
            return 0.0
        usable = LEVELS * self.trim - self.dead_band
        level = round(self.dead_band + usable * abs(step) / STEP_LIMIT)
        return math.copysign(level / LEVELS, step)

    def step(self, duty: float) -> int:
        """The step in -250..250 that becomes this duty, or the one next to it."""
        usable = LEVELS * self.trim - self.dead_band
        share = (LEVELS * abs(duty) - self.dead_band) / usable
        step = max(1, min(STEP_LIMIT, round(share * STEP_LIMIT))) if duty else 0
        return step if duty > 0 else -step


class WheelMaps(Struct, frozen=True, forbid_unknown_fields=True):
    """Both wheels of a robot. An mBot's left motor stands mirrored: it is reversed (measured)."""

    left: MotorMap = MotorMap()
    right: MotorMap = MotorMap()

    def __post_init__(self) -> None:
        for side, mirrored in (("left", True), ("right", False)):
            own: MotorMap = getattr(self, side)
            if own.reversed is None:
                structs.force_setattr(self, side, structs.replace(own, reversed=mirrored))

    def duties(self, steps: Steps) -> Duties:
        """The wheels' duties for these steps."""
        return Duties(self.left.duty(steps.left), self.right.duty(steps.right))

    def steps(self, duties: Duties) -> Steps:
        """The steps of these duties: `duties` backwards."""
        return Steps(self.left.step(duties.left), self.right.step(duties.right))

    def at_motors(self, duties: Duties) -> Duties:
        """The same as the motors have it: a reversed one runs backward when its wheel rolls
        forward. It is its own inverse.
        """
        return Duties(
            0.0 - duties.left if self.left.reversed else duties.left,  # and no -0.0
            0.0 - duties.right if self.right.reversed else duties.right,
        )

    def levels(self, duties: Duties) -> tuple[int, int]:
        """What the motors get in 255ths: `board_m1` and `board_m2` of messages and recordings."""
        motors = self.at_motors(duties)
        return round(motors.left * LEVELS), round(motors.right * LEVELS)

    def of_levels(self, left: int, right: int) -> Duties:
        """The wheels' duties that `levels` tells of.

        Raises:
            ValueError: a level is not in -255..255.

        """
        return self.at_motors(Duties(left / LEVELS, right / LEVELS))


AS_BUILT = WheelMaps()
"""An mBot whose motors nobody has measured."""


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
