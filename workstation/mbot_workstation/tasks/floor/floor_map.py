"""Where on the floor a robot can drive, and the shortest way there: for guides, who know both.

A square grid, obstacles grown by the robot's radius and some room. From a goal the distance of
every cell is found at once, by passing on the least of the neighbours' until nothing changes: one
goal serves a robot for many decisions, from wherever it is by then.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbot_workstation.sim.pose import Pose
from mbot_workstation.tasks.floor.solids import Solids

CELL_M = 0.1

ROOM_M = 0.07
"""Beside the robot, at least; where there is less, it does not pass."""

_NEIGHBOURS = tuple(
    (dx, dy, math.hypot(dx, dy) * CELL_M)
    for dx in (-1, 0, 1)
    for dy in (-1, 0, 1)
    if (dx, dy) != (0, 0)
)


@dataclass(frozen=True, slots=True, eq=False)
class FloorMap:
    """A square floor about the origin.

    Attributes:
        reach_m: how far it goes to every side.
        solids: what can't be driven through.
        robot_radius_m: of the robot that is to pass.

    """

    reach_m: float
    solids: Solids
    robot_radius_m: float

    def ways_to(self, goal: Pose) -> "Ways":
        """The shortest ways from everywhere to this place, which is taken for free."""
        gaps_m = self.solids.gaps_m(self._centres())
        taken = np.asarray(np.any(gaps_m < self.robot_radius_m + ROOM_M, axis=-1))
        cell = self.cell(goal)
        taken[cell] = False
        far = np.full((len(taken) + 2,) * 2, np.inf)
        far[cell[0] + 1, cell[1] + 1] = 0.0
        inner = far[1:-1, 1:-1]
        while True:
            before = inner.copy()
            for dx, dy, way_m in _NEIGHBOURS:
                beside = far[1 + dx : far.shape[0] - 1 + dx, 1 + dy : far.shape[1] - 1 + dy]
                np.minimum(inner, beside + way_m, out=inner)
            inner[taken] = np.inf
            if np.array_equal(inner, before):
                return Ways(self, goal, inner.copy())

    def is_clear(self, start: Pose, ends: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether the straight way to each place, shape (n, 2), is free."""
        gaps_m = self.solids.beside_m(start, ends) - self.solids.radii_m
        here_m = self.solids.gaps_m(np.array([start.x_m, start.y_m]))
        # Who stands too near already may drive away.
        enough_m = np.minimum(self.robot_radius_m + 0.7 * ROOM_M, here_m - 1e-3)
        return np.asarray(np.all(gaps_m >= enough_m, axis=1))

    def is_free(self, place: Pose) -> bool:
        """Whether the robot can stand there."""
        gaps_m = self.solids.gaps_m(np.array([place.x_m, place.y_m]))
        return bool((gaps_m >= self.robot_radius_m + ROOM_M).all())

    def is_in_sight(self, eye: Pose, place: Pose) -> bool:
        """Whether nothing stands in between."""
        beside_m = self.solids.beside_m(eye, np.array([[place.x_m, place.y_m]]))
        return bool((beside_m[0] > self.solids.radii_m).all())

    def cell(self, place: Pose) -> tuple[int, int]:
        """The cell of a place; outside the nearest."""
        most = self._side - 1
        x, y = (int((at_m + self.reach_m) // CELL_M) for at_m in (place.x_m, place.y_m))
        return min(max(x, 0), most), min(max(y, 0), most)

    @property
    def _side(self) -> int:
        return math.ceil(2 * self.reach_m / CELL_M)

    def _centres(self) -> NDArray[np.float64]:
        """Of the cells, shape (side, side, 2)."""
        at_m = (np.arange(self._side, dtype=np.float64) + 0.5) * CELL_M - self.reach_m
        return np.stack(np.meshgrid(at_m, at_m, indexing="ij"), axis=-1)


@dataclass(frozen=True, slots=True, eq=False)
class Ways:
    """The shortest ways to a goal.

    Attributes:
        floor: on which.
        goal: where they end.
        far_m: of every cell; infinite where no way leads.

    """

    floor: FloorMap
    goal: Pose
    far_m: NDArray[np.float64]

    def from_m(self, place: Pose) -> float:
        """How far it is from there; infinite where no way leads."""
        return float(self.far_m[self.floor.cell(place)])

    def next_from(self, robot: Pose) -> Pose:
        """The furthest place of the way that can be driven to in a straight line; the goal if
        there is no way.
        """
        places = np.array([*self._cells_from(robot), (self.goal.x_m, self.goal.y_m)])
        clear = self.floor.is_clear(robot, places)
        if not clear.any():
            return self.goal
        x_m, y_m = places[int(np.flatnonzero(clear)[-1])].tolist()
        return Pose(x_m, y_m, self.goal.yaw_rad)

    def _cells_from(self, robot: Pose) -> list[tuple[float, float]]:
        """Middles of the cells on the way, downhill."""
        x, y = self.floor.cell(robot)
        way: list[tuple[float, float]] = []
        most = len(self.far_m)
        here = self.far_m[x, y]
        for _ in range(most * most):
            around = [
                (float(self.far_m[x + dx, y + dy]), x + dx, y + dy)
                for dx, dy, _ in _NEIGHBOURS
                if 0 <= x + dx < most and 0 <= y + dy < most
            ]
            lowest, x, y = min(around)
            if lowest >= here or not math.isfinite(lowest):
                break
            here = lowest
            way.append(
                ((x + 0.5) * CELL_M - self.floor.reach_m, (y + 0.5) * CELL_M - self.floor.reach_m)
            )
        return way
