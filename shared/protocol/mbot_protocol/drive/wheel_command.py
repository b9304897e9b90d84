"""What the wheels are told: two duties, for how long at most, and while what holds.

This is all that crosses the door to a board. Frames, signs and units of one kind of board stand
behind it.
"""

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Duties:
    """Share of full drive of both wheels, in [-1, 1]; positive is forward, 0 stands.

    Raises:
        ValueError: a duty is not a number in [-1, 1].

    """

    left: float
    right: float

    def __post_init__(self) -> None:
        for name, duty in (("left", self.left), ("right", self.right)):
            if not -1.0 <= duty <= 1.0:  # also false for NaN
                raise ValueError(f"{name} is {duty!r}, expected a number in [-1, 1]")

    @property
    def is_stop(self) -> bool:
        """Whether both wheels are off."""
        return self.left == 0 and self.right == 0


STOP = Duties(0.0, 0.0)


def always() -> bool:
    """The guard of a command that needs none."""
    return True


@dataclass(frozen=True, slots=True)
class WheelCommand:
    """What the wheels should do, and for how long at most.

    Attributes:
        duties: of both wheels.
        deadline_ns: monotonic; the wheels stop then at the latest.
        guard: asked before every repetition; false stops the wheels.

    """

    duties: Duties
    deadline_ns: int
    guard: Callable[[], bool] = always
