"""Closed lines of tape on the floor: where they run, how far away they are, what they look like."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbot_workstation.sim.pose import Pose
from mbot_workstation.sim.scene.scene_look import Distractor
from mbot_workstation.sim.scene.target_object import Rgb

WIDTH_M, THICK_M = 0.02, 0.0006
BLACK: Rgb = (0.03, 0.03, 0.03)
PIECE_M = 0.13
"""Of tape, at most: a curve is laid in straight pieces."""

Points = NDArray[np.float64]
"""Shape (n, 2), in metres; the last one is followed by the first."""


@dataclass(frozen=True, slots=True, eq=False)
class Tape:
    """A closed line.

    Attributes:
        points: what it is laid through.

    """

    points: Points

    def away_m(self, x_m: float, y_m: float) -> float:
        """How far the nearest of it is."""
        start, side = self.points, self._sides
        to_start = start - (x_m, y_m)
        along = -(to_start * side).sum(axis=1) / (side * side).sum(axis=1)
        nearest = to_start + np.clip(along, 0, 1)[:, None] * side
        return float(np.sqrt((nearest * nearest).sum(axis=1).min()))

    def encloses(self, x_m: float, y_m: float) -> bool:
        """Whether a place is inside."""
        start, end = self.points, np.roll(self.points, -1, axis=0)
        # Each corner belongs to one of its two sides, or a line through it would count it twice.
        over = (start[:, 1] > y_m) != (end[:, 1] > y_m)
        rise = np.where(over, end[:, 1] - start[:, 1], 1.0)
        at_x = start[:, 0] + (y_m - start[:, 1]) / rise * (end[:, 0] - start[:, 0])
        return bool((over & (at_x > x_m)).sum() % 2)

    def way_m(self, start: Pose) -> float:
        """How far it is along a heading; infinite if it is never met."""
        ahead = np.array([math.cos(start.yaw_rad), math.sin(start.yaw_rad)])
        to_start, side = self.points - (start.x_m, start.y_m), self._sides
        across = ahead[0] * side[:, 1] - ahead[1] * side[:, 0]
        parallel = np.abs(across) < 1e-12
        across = np.where(parallel, 1.0, across)
        along_m = (to_start[:, 0] * side[:, 1] - to_start[:, 1] * side[:, 0]) / across
        share = (to_start[:, 0] * ahead[1] - to_start[:, 1] * ahead[0]) / across
        met = ~parallel & (along_m > 0) & (share >= 0) & (share <= 1)
        return float(np.where(met, along_m, math.inf).min())

    @property
    def _sides(self) -> Points:
        return np.roll(self.points, -1, axis=0) - self.points

    def pieces(self, rgb: Rgb = BLACK) -> tuple[Distractor, ...]:
        """Flat boxes from point to point, each half a width longer so that corners close."""
        made: list[Distractor] = []
        for (x_m, y_m), (dx, dy) in zip(self.points.tolist(), self._sides.tolist(), strict=True):
            half = ((math.hypot(dx, dy) + WIDTH_M) / 2, WIDTH_M / 2, THICK_M / 2)
            middle = (x_m + dx / 2, y_m + dy / 2, THICK_M / 2)
            made.append(Distractor("box", half, middle, math.atan2(dy, dx), rgb))
        return tuple(made)


def round_line(
    rng: np.random.Generator, radius_m: tuple[float, float], dents: float, piece_m: float = PIECE_M
) -> Points:
    """About the origin, with two and three waves: dents of up to this share of the radius and half
    of it.
    """
    radius = rng.uniform(*radius_m)
    around = np.linspace(0, 2 * math.pi, 400, endpoint=False)
    waves = sum(
        rng.uniform(0, dents) / (lobes - 1) * np.cos(lobes * around + rng.uniform(0, 2 * math.pi))
        for lobes in (2, 3)
    )
    away = radius * (1 + waves)
    return even(np.stack([away * np.cos(around), away * np.sin(around)], axis=1), piece_m)


def figure_eight(
    rng: np.random.Generator, reach_m: tuple[float, float], piece_m: float = PIECE_M
) -> Points:
    """About the origin, where it crosses itself."""
    around = np.linspace(0, 2 * math.pi, 400, endpoint=False)
    x = np.sin(around)
    return even(rng.uniform(*reach_m) * np.stack([x, x * np.cos(around)], axis=1), piece_m)


def even(points: Points, piece_m: float) -> Points:
    """The same closed line through points that are equally far apart, about so far."""
    closed = np.vstack([points, points[:1]])
    way_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(closed, axis=0).T))])
    count = max(3, math.ceil(way_m[-1] / piece_m))
    at_m = np.arange(count) * way_m[-1] / count
    return np.stack([np.interp(at_m, way_m, closed[:, side]) for side in (0, 1)], axis=1)


def laid_from(points: Points, first: int) -> Points:
    """Moved and turned: this one is the origin, and the line runs along +x from there."""
    points = np.roll(points, -first, axis=0)
    ahead = points[1] - points[-1]
    cos, sin = ahead / np.hypot(*ahead)
    return (points - points[0]) @ np.array([[cos, -sin], [sin, cos]])
