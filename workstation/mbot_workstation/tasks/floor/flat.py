"""Flats: an arena cut into rooms by walls with doors, drawn at random.

A rectangle is cut in two, and each part again, until rooms are small; every cut leaves a door open.
So all rooms can be reached, and what is in one is not seen from the next.
"""

import math
from dataclasses import dataclass

import numpy as np

from mbot_workstation.sim.scene.scene_look import Distractor
from mbot_workstation.sim.scene.target_object import Rgb
from mbot_workstation.tasks.floor.solids import Wall

HALF_M = 3.0
"""Walls end where the arena's boards stand."""

DOOR_M = (0.6, 0.9)
FROM_CORNER_M = 0.25
"""Between a door and the next wall."""

SMALLEST_M = 1.7
"""Of a room's sides: one that is longer than twice that may be cut."""

FROM_START_M = 0.45
"""No wall is nearer to where the robot begins."""

HEIGHT_M = (0.3, 1.2)
MOST_TRIES = 20


@dataclass(frozen=True, slots=True)
class Flat:
    """One of them.

    Attributes:
        walls: the parts between doors.
        rooms: x0, y0, x1, y1 of each, in metres.

    """

    walls: tuple[Wall, ...]
    rooms: tuple[tuple[float, float, float, float], ...]

    def pieces(self, rng: np.random.Generator) -> tuple[Distractor, ...]:
        """As they are drawn: of one height and a light colour, each a little otherwise."""
        height_m, base = rng.uniform(*HEIGHT_M), rng.uniform(0.55, 0.95, 3)
        base = base.mean() + 0.4 * (base - base.mean())
        made: list[Distractor] = []
        for wall in self.walls:
            red, green, blue = np.clip(base * rng.uniform(0.92, 1.08), 0, 1).tolist()
            rgb: Rgb = (red, green, blue)
            made.append(wall.piece(height_m, rgb))
        return tuple(made)


def draw_flat(rng: np.random.Generator, cuts: int) -> Flat:
    """A flat with so many cuts, or fewer where rooms are small already."""
    rooms = [(-HALF_M, -HALF_M, HALF_M, HALF_M)]
    walls: list[Wall] = []
    for _ in range(cuts):
        rooms.sort(key=lambda room: (room[2] - room[0]) * (room[3] - room[1]))
        room = rooms.pop()
        parts = _cut(rng, room, walls)
        rooms += [room] if parts is None else parts
    return Flat(tuple(walls), tuple(rooms))


def _cut(
    rng: np.random.Generator, room: tuple[float, float, float, float], walls: list[Wall]
) -> list[tuple[float, float, float, float]] | None:
    """Cut a room across its longer side; the wall is added. None if there is no place for it."""
    x0, y0, x1, y1 = room
    along_x = x1 - x0 >= y1 - y0
    low, high = (x0, x1) if along_x else (y0, y1)
    begin, end = (y0, y1) if along_x else (x0, x1)
    if high - low < 2 * SMALLEST_M:
        return None
    for _ in range(MOST_TRIES):
        at_m = rng.uniform(low + SMALLEST_M, high - SMALLEST_M)
        width_m = rng.uniform(*DOOR_M)
        door_m = rng.uniform(begin + FROM_CORNER_M, end - FROM_CORNER_M - width_m)
        made = [
            Wall(at_m, a, at_m, b) if along_x else Wall(a, at_m, b, at_m)
            for a, b in ((begin, door_m), (door_m + width_m, end))
        ]
        if all(_from_start_m(one) >= FROM_START_M for one in made) and _fits(made, walls):
            walls += made
            if along_x:
                return [(x0, y0, at_m, y1), (at_m, y0, x1, y1)]
            return [(x0, y0, x1, at_m), (x0, at_m, x1, y1)]
    return None


def _from_start_m(wall: Wall) -> float:
    x = min(max(0.0, min(wall.x0_m, wall.x1_m)), max(wall.x0_m, wall.x1_m))
    y = min(max(0.0, min(wall.y0_m, wall.y1_m)), max(wall.y0_m, wall.y1_m))
    return math.hypot(x, y)


def _fits(made: list[Wall], walls: list[Wall]) -> bool:
    """Whether a new wall, its door included, begins and ends at the boards or on older walls, and
    away from where these end: from their doors.
    """
    first, last = made
    outer = [(first.x0_m, first.y0_m), (last.x1_m, last.y1_m)]
    ends = [end for one in walls for end in ((one.x0_m, one.y0_m), (one.x1_m, one.y1_m))]
    return all(
        (max(abs(x), abs(y)) >= HALF_M or _is_on_wall(x, y, walls))
        and all(math.hypot(x - ex, y - ey) >= FROM_CORNER_M for ex, ey in ends)
        for x, y in outer
    )


def _is_on_wall(x_m: float, y_m: float, walls: list[Wall]) -> bool:
    return any(
        min(wall.x0_m, wall.x1_m) - 1e-9 <= x_m <= max(wall.x0_m, wall.x1_m) + 1e-9
        and min(wall.y0_m, wall.y1_m) - 1e-9 <= y_m <= max(wall.y0_m, wall.y1_m) + 1e-9
        for wall in walls
    )
