"""Where something stands on the floor."""

import math
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

    def point(self, ahead_m: float, left_m: float) -> tuple[float, float]:
        """Where a point lies that is so far ahead and to the left."""
        cos, sin = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return (
            self.x_m + ahead_m * cos - left_m * sin,
            self.y_m + ahead_m * sin + left_m * cos,
        )


ORIGIN = Pose(0.0, 0.0, 0.0)
