"""What can't be driven through: things and walls, each a line with a radius about it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from mbot_workstation.sim.pose import Pose
from mbot_workstation.sim.scene.scene_look import Distractor, Standing
from mbot_workstation.sim.scene.target_object import Rgb

Places = NDArray[np.float64]
"""Shape (..., 2), in metres."""

WALL_M = 0.06
"""How thick walls are."""


@dataclass(frozen=True, slots=True)
class Wall:
    """Straight, from one place to another."""

    x0_m: float
    y0_m: float
    x1_m: float
    y1_m: float

    def piece(self, height_m: float, rgb: Rgb) -> Distractor:
        """What is drawn."""
        dx, dy = self.x1_m - self.x0_m, self.y1_m - self.y0_m
        half = ((math.hypot(dx, dy) + WALL_M) / 2, WALL_M / 2, height_m / 2)
        middle = (self.x0_m + dx / 2, self.y0_m + dy / 2, height_m / 2)
        return Distractor("box", half, middle, math.atan2(dy, dx), rgb)


@dataclass(frozen=True, slots=True, eq=False)
class Solids:
    """Some of them.

    Attributes:
        starts, ends: of their lines, shape (n, 2).
        radii_m: about these, shape (n,).

    """

    starts: Places
    ends: Places
    radii_m: NDArray[np.float64]

    @classmethod
    def of(cls, things: Sequence[Standing], walls: Sequence[Wall] = ()) -> Self:
        """These, the things first."""
        points = [(one.x_m, one.y_m) for one in things]
        starts = [*points, *((wall.x0_m, wall.y0_m) for wall in walls)]
        ends = [*points, *((wall.x1_m, wall.y1_m) for wall in walls)]
        radii = [*(one.radius_m for one in things), *(WALL_M / 2 for _ in walls)]
        shape = (len(radii), 2)
        return cls(np.reshape(starts, shape), np.reshape(ends, shape), np.array(radii, np.float64))

    def gaps_m(self, places: Places) -> NDArray[np.float64]:
        """From each place, shape (..., 2), to the surface of each, shape (..., n); less than 0
        inside.
        """
        return _norm(_to_line(places[..., None, :], self.starts, self.ends)) - self.radii_m

    def out_of_m(self, robot: Pose, radius_m: float, hardly_m: float) -> tuple[float, float]:
        """By how much, in x and y, a round robot is to be moved so that it overlaps none; overlaps
        below `hardly_m` are none.
        """
        to_line = _to_line(np.array([robot.x_m, robot.y_m]), self.starts, self.ends)
        away_m = np.maximum(_norm(to_line), 1e-6)
        too_near_m = self.radii_m + radius_m - away_m
        too_near_m[too_near_m <= hardly_m] = 0.0
        x_m, y_m = (-to_line * (too_near_m / away_m)[:, None]).sum(axis=0).tolist()
        return x_m, y_m

    def beside_m(self, start: Pose, ends: Places) -> NDArray[np.float64]:
        """How near straight ways from a place to others, shape (m, 2), come to each line, shape
        (m, n); 0 where they cross.
        """
        here = np.array([start.x_m, start.y_m])
        ways = ends[:, None, :]
        nearest = np.minimum.reduce(
            [
                _norm(_to_line(self.starts[None], here, ways)),
                _norm(_to_line(self.ends[None], here, ways)),
                np.broadcast_to(
                    _norm(_to_line(here, self.starts, self.ends)), (len(ends), len(self.radii_m))
                ),
                _norm(_to_line(ways, self.starts[None], self.ends[None])),
            ]
        )
        apart = _side(here, ways, self.starts) * _side(here, ways, self.ends)
        across = _side(self.starts, self.ends, here) * _side(self.starts, self.ends, ways)
        return np.where((apart < 0) & (across < 0), 0.0, nearest)


def _to_line(places: Places, starts: Places, ends: Places) -> Places:
    """From places to the nearest of lines between two places."""
    sides, back = ends - starts, places - starts
    length2 = np.maximum((sides * sides).sum(axis=-1), 1e-12)
    share = np.clip((back * sides).sum(axis=-1) / length2, 0.0, 1.0)
    return share[..., None] * sides - back


def _side(starts: Places, ends: Places, places: Places) -> NDArray[np.float64]:
    """On which side of lines places are: above 0 to the left."""
    sides, back = ends - starts, places - starts
    return sides[..., 0] * back[..., 1] - sides[..., 1] * back[..., 0]


def _norm(vectors: Places) -> NDArray[np.float64]:
    return np.sqrt((vectors * vectors).sum(axis=-1))
