"""How a change moves a path, seen from the robot: so what is worked out for one run serves others.

Repetitions of a manoeuvre differ by a percent of speed, which is radians of heading after 10 s, so
their places change in other directions. Seen from the robot, though, a change adds the same way
and the same turn to each step. One simulation a parameter and manoeuvre is enough then, instead of
one a parameter and run.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbot_workstation.identification.flat_track import Plane
from mbot_workstation.recordings.track import Array


@dataclass(frozen=True, slots=True, eq=False)
class Twists:
    """Per unit of a change, what each step of the path gets more, seen from the robot.

    Attributes:
        way: [m], ahead + i left, shape (n, steps).
        turn: [rad], shape (n, steps).

    """

    way: Plane
    turn: Array

    def rows(self, chosen: Sequence[int]) -> "Twists":
        """Those of some changes only."""
        return Twists(self.way[list(chosen)], self.turn[list(chosen)])


def twists_of(path: Array, changed: Array) -> Twists:
    """Of a path, shape (steps + 1, 3), and its derivatives, shape (n, steps + 1, 3)."""
    step = np.diff(path[:, 0] + 1j * path[:, 1])
    more = np.diff(changed[..., 0] + 1j * changed[..., 1], axis=-1)
    way = (more - 1j * step * changed[..., 1:, 2]) * np.exp(-1j * path[1:, 2])
    return Twists(way, np.diff(changed[..., 2], axis=-1))


def along(path: Array, twists: Twists) -> tuple[Plane, Array]:
    """What a path gets by them: places and headings, shape (n, steps + 1)."""
    steps = len(path) - 1
    step = np.diff(path[:, 0] + 1j * path[:, 1])
    turned = np.cumsum(twists.turn[:, :steps], axis=-1)
    more = np.exp(1j * path[1:, 2]) * twists.way[:, :steps] + 1j * step * turned
    place = np.zeros((len(turned), steps + 1), np.complex128)
    place[:, 1:] = np.cumsum(more, axis=-1)
    return place, np.hstack([np.zeros((len(turned), 1)), turned])
