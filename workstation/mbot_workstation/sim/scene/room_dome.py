"""The surface the 360-degree photo is projected on: an upright cylinder closed by a half sphere.

It stands around the arena at a finite distance, so that the room shows parallax when the robot
moves. The photo is projected from the point where it was taken.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbot_workstation.sim.scene.scene_parameters import Room

COLUMNS = 32
"""Around; 11.3 degrees each, where the polygon is at most 0.5 % nearer than the arc. Twice as many
would make a training picture a sixth dearer."""

WALL_RINGS, ROOF_RINGS = 5, 2
"""Up the cylinder, since the photo's rows are not linear in height; and over the roof, which no
policy sees. Every corner costs: with 10 and 5 a training picture takes a seventh longer, and errs
against a dome of 128 columns and 80 rings by 0.52 instead of 0.56 grey levels RMS (measured)."""


@dataclass(frozen=True, slots=True)
class DomeMesh:
    """Triangles that face inwards, with a place in the photo for every corner.

    Attributes:
        vertices_m: shape (n, 3), float32; z = 0 is the floor.
        texture: shape (n, 2), float32; u runs to the right of the photo, v down from its top.
        triangles: shape (m, 3), int32, indices into both.

    """

    vertices_m: NDArray[np.float32]
    texture: NDArray[np.float32]
    triangles: NDArray[np.int32]


def dome_mesh(room: Room) -> DomeMesh:
    """The dome for a room; the photo's middle column lies in the direction of +x."""
    wall_top_m = room.photo_height_m + room.distance_m / 2
    rings = [(room.distance_m, z) for z in np.linspace(0.0, wall_top_m, WALL_RINGS + 1)]
    for angle in np.linspace(0, np.pi / 2, ROOF_RINGS + 1)[1:]:
        # Not quite to the middle: a ring of radius 0 would make triangles without an area.
        radius_m = max(room.distance_m * np.cos(angle), 0.01)
        rings.append((radius_m, wall_top_m + room.distance_m * np.sin(angle)))

    # One more column than there are sides: the seam's corners exist twice, with u = 0 and u = 1.
    u, ring = np.meshgrid(np.linspace(0, 1, COLUMNS + 1), np.arange(len(rings)))
    radius_m, height_m = (np.array(values)[ring] for values in zip(*rings, strict=True))
    yaw = np.pi * (1 - 2 * u)  # the photo's left edge is straight behind, to the right = clockwise
    vertices = np.stack([radius_m * np.cos(yaw), radius_m * np.sin(yaw), height_m], axis=-1)
    elevation = np.arctan2(height_m - room.photo_height_m, radius_m)
    texture = np.stack([u, 0.5 - elevation / np.pi], axis=-1)
    return DomeMesh(
        vertices_m=vertices.reshape(-1, 3).astype(np.float32),
        texture=texture.reshape(-1, 2).astype(np.float32),
        triangles=_triangles(len(rings)),
    )


def _triangles(rings: int) -> NDArray[np.int32]:
    """Two triangles for every cell of the grid, counter-clockwise as seen from inside."""
    column, ring = np.meshgrid(np.arange(COLUMNS), np.arange(rings - 1))
    lower_left = (ring * (COLUMNS + 1) + column).ravel()
    upper_left = lower_left + COLUMNS + 1
    lower = np.stack([lower_left, lower_left + 1, upper_left + 1], axis=-1)
    upper = np.stack([lower_left, upper_left + 1, upper_left], axis=-1)
    return np.concatenate([lower, upper]).astype(np.int32)
