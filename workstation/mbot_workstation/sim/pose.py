"""Where something stands on the floor."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Pose:
    """A place and a heading in the arena.

    Attributes:
        x_m, y_m: from the arena's centre.
        yaw_rad: heading, 0 along +x, positive to the left (counter-clockwise from above).

    """

    x_m: float
    y_m: float
    yaw_rad: float = 0.0


ORIGIN = Pose(0.0, 0.0, 0.0)
