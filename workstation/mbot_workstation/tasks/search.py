"""Where to look next, when a whole turn on the spot showed nothing.

What a guide does and a policy with a memory can learn: turn around once; if what it looks for was
not in any picture, it is hidden or too far away, so drive to where it has not looked from yet, and
turn again. The places are the arena's middle and eight around it, the nearest one first.
"""

import math

from mbot_workstation.sim.pose import Pose

WHOLE_TURN_RAD = 2.2 * math.pi
"""A turn and a bit: pictures are late."""

THERE_M = 0.25
AROUND_M = 1.3

MIDDLE = (0.0, 0.0)

PLACES = (
    MIDDLE,
    *((AROUND_M * math.cos(turn), AROUND_M * math.sin(turn)) for turn in
      (number * math.pi / 4 for number in range(8))),
)  # fmt: skip


class Search:
    """For one thing; tell it how the robot drives.

    Args:
        places: from which there is something to be seen.

    Attributes:
        goes_to: the place to look from next; None while the robot is to turn where it is.

    """

    def __init__(self, places: tuple[tuple[float, float], ...] = PLACES) -> None:
        self._places = places
        self.begin()

    def begin(self) -> None:
        """Look for another thing, or for the same again: it was in view."""
        self._turned_rad = 0.0
        self._yaw_rad: float | None = None  # it may have been carried
        self._looked_from: set[tuple[float, float]] = set()
        self.goes_to: Pose | None = None

    def advance(self, robot: Pose, taken: tuple[tuple[float, float, float], ...] = ()) -> None:
        """Go on to where the robot is now.

        Args:
            robot: its pose.
            taken: x, y and radius of what stands in the way, with the robot's own radius.

        """
        if self._yaw_rad is not None:
            turned = (robot.yaw_rad - self._yaw_rad + math.pi) % (2 * math.pi) - math.pi
            self._turned_rad += abs(turned)
        self._yaw_rad = robot.yaw_rad
        if (place := self.goes_to) is not None:
            if math.hypot(robot.x_m - place.x_m, robot.y_m - place.y_m) < THERE_M:
                self.goes_to, self._turned_rad = None, 0.0
        elif self._turned_rad > WHOLE_TURN_RAD:
            self.goes_to = self._next(robot, taken)

    def _next(self, robot: Pose, taken: tuple[tuple[float, float, float], ...]) -> Pose | None:
        free = [
            (x, y)
            for x, y in self._places
            if all(math.hypot(x - ox, y - oy) > radius for ox, oy, radius in taken)
        ]
        left = [place for place in free if place not in self._looked_from]
        if not left:
            self._looked_from.clear()
            left = free
        # Where it stands now it has looked.
        away = {place: math.hypot(robot.x_m - place[0], robot.y_m - place[1]) for place in left}
        self._looked_from |= {place for place in left if away[place] < THERE_M}
        others = [place for place in left if away[place] >= THERE_M]
        if not others:
            return None
        return Pose(*min(others, key=lambda place: away[place]))
