"""Where to look next, when a whole turn on the spot showed nothing.

What a guide does and a policy with a memory can learn: turn around once; if what it looks for was
not in any picture, it is hidden or too far away, so drive to where the floor has not been seen yet,
and turn again: frontier exploration (Yamauchi 1997) on a handful of places. A place is done with
once it was in sight of a turn; the one with the shortest way comes next.
"""

import math

from mbot_workstation.sim.pose import Pose
from mbot_workstation.tasks.floor.floor_map import FloorMap, Ways

WHOLE_TURN_RAD = 2.2 * math.pi
"""A turn and a bit: pictures are late."""

THERE_M = 0.25

SEEN_M = 3.0
"""What is looked for is noticed from so far."""

RINGS_M = (1.3, 2.2)
MIDDLE = (0.0, 0.0)

PLACES = (
    MIDDLE,
    *(
        (reach_m * math.cos(turn), reach_m * math.sin(turn))
        for reach_m in RINGS_M
        for turn in (number * math.pi / 4 for number in range(8))
    ),
)


class Search:
    """For one thing; tell it how the robot drives.

    Args:
        places: from which there is something to be seen.
        seen_m: from how far it is noticed.

    Attributes:
        goes_to: the place to look from next; None while the robot is to turn where it is.

    """

    def __init__(
        self, places: tuple[tuple[float, float], ...] = PLACES, seen_m: float = SEEN_M
    ) -> None:
        self._places, self._seen_m = places, seen_m
        self.begin()

    def begin(self) -> None:
        """Look for another thing, or for the same again: it was in view."""
        self._turned_rad = 0.0
        self._yaw_rad: float | None = None  # it may have been carried
        self._done: set[tuple[float, float]] = set()
        self.goes_to: Pose | None = None

    def advance(self, robot: Pose, floor: FloorMap | None = None) -> None:
        """Go on to where the robot is now; on a floor, places that are taken are left out."""
        if self._yaw_rad is not None:
            turned = (robot.yaw_rad - self._yaw_rad + math.pi) % (2 * math.pi) - math.pi
            self._turned_rad += abs(turned)
        self._yaw_rad = robot.yaw_rad
        if (place := self.goes_to) is not None:
            if math.hypot(robot.x_m - place.x_m, robot.y_m - place.y_m) < THERE_M:
                self.goes_to, self._turned_rad = None, 0.0
        elif self._turned_rad > WHOLE_TURN_RAD:
            self.goes_to = self._next(robot, floor)

    def _next(self, robot: Pose, floor: FloorMap | None) -> Pose | None:
        free = [one for one in self._places if floor is None or floor.is_free(Pose(*one))]
        self._done |= {place for place in free if self._is_in_sight(robot, place, floor)}
        left = [place for place in free if place not in self._done]
        if not left:  # it was there and went unnoticed
            self._done.clear()
            left = [place for place in free if _away_m(robot, place) >= THERE_M]
        if not left:
            return None
        ways = None if floor is None else floor.ways_to(robot)
        return Pose(*min(left, key=lambda one: _way_m(robot, one, ways)))

    def _is_in_sight(self, robot: Pose, place: tuple[float, float], floor: FloorMap | None) -> bool:
        if _away_m(robot, place) >= self._seen_m:
            return False
        return floor is None or floor.is_in_sight(robot, Pose(*place))


def _away_m(robot: Pose, place: tuple[float, float]) -> float:
    return math.hypot(robot.x_m - place[0], robot.y_m - place[1])


def _way_m(robot: Pose, place: tuple[float, float], ways: Ways | None) -> float:
    return _away_m(robot, place) if ways is None else ways.from_m(Pose(*place))
