"""What the kit's sensors would tell: a floor under two infrared pairs, an echo from ahead.

Where they sit is assumed from the kit's drawings: nobody has measured it. The echo is the nearest
of some rays in the cone that the ultrasonic sensor hears; what is slanted sends it elsewhere.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from mbot_workstation.sim.pose import Pose

FARTHEST_M = 4.0
CONE_RAD = math.radians(15.0)
RAYS = 7
MOST_SLANT_RAD = math.radians(35.0)
"""From a smooth wall that is more slanted nothing comes back. Assumed."""

Segment = tuple[tuple[float, float], tuple[float, float]]
"""A wall seen from above, in metres."""


@dataclass(frozen=True, slots=True)
class Feelers:
    """Where the sensors sit, from the axle's centre: ahead and left, in metres.

    Attributes:
        pairs: the infrared pairs, two or four of them.
        sonar: the ultrasonic sensor, which looks ahead.

    """

    pairs: tuple[tuple[float, float], ...] = ((0.060, 0.008), (0.060, -0.008))
    sonar: tuple[float, float] = (0.095, 0.0)

    def has_floor(self, pose: Pose, floor: Callable[[float, float], bool]) -> tuple[bool, bool]:
        """What a module tells: the first half of the pairs, and the others.

        Args:
            pose: the robot's.
            floor: whether there is one at x, y.

        """
        seen = [floor(*pose.point(*pair)) for pair in self.pairs]
        half = len(seen) // 2
        return all(seen[:half]), all(seen[half:])

    def echo_m(self, pose: Pose, walls: Iterable[Segment]) -> float:
        """How far away the nearest thing is that answers; 0 if nothing does."""
        start = pose.point(*self.sonar)
        near = [
            distance_m
            for wall in walls
            for ray in range(RAYS)
            if (distance_m := _hit(start, _angle(pose, ray), wall)) is not None
        ]
        return min(near, default=0.0)


def _angle(pose: Pose, ray: int) -> float:
    return pose.yaw_rad + CONE_RAD * (2 * ray / (RAYS - 1) - 1)


def _hit(start: tuple[float, float], angle_rad: float, wall: Segment) -> float | None:
    """Where a ray meets a wall, if it does and comes back."""
    (x, y), ((x1, y1), (x2, y2)) = start, wall
    ray_x, ray_y = math.cos(angle_rad), math.sin(angle_rad)
    along_x, along_y = x2 - x1, y2 - y1
    across = ray_x * along_y - ray_y * along_x
    length = math.hypot(along_x, along_y)
    if abs(across) < length * math.cos(MOST_SLANT_RAD):
        return None
    distance_m = ((x1 - x) * along_y - (y1 - y) * along_x) / across
    share = ((x1 - x) * ray_y - (y1 - y) * ray_x) / across
    return distance_m if 0 < distance_m < FARTHEST_M and 0 <= share <= 1 else None
