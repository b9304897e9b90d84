"""What the robot fetches: shape, size, colour; the paper's is a red cube, yours may be another."""

import colorsys
import math
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from mbot_protocol.drive.picture import Picture

Rgb = tuple[float, float, float]
"""Each in [0, 1]."""


class Shape(StrEnum):
    """What it is to the renderer."""

    CUBE = "cube"
    BALL = "ball"
    CYLINDER = "cylinder"
    MESH = "mesh"


@dataclass(frozen=True, slots=True)
class MeshPart:
    """A part of a mesh: triangles with one picture on them, or none.

    Attributes:
        vertices_m: shape (n, 3).
        triangles: indices of vertices, shape (m, 3).
        picture: shape (h, w, 3), RGB.
        corners_uv: where each triangle's corners are in it, the origin being its upper left
            corner; shape (m, 3, 2). None without a picture.

    """

    vertices_m: NDArray[np.float64]
    triangles: NDArray[np.int32]
    picture: Picture | None = None
    corners_uv: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True)
class Mesh:
    """A surface of triangles, standing on z = 0 with its footprint's middle in the origin, in m.

    Attributes:
        parts: at least one.
        mean_rgb: of its pictures, by area; white without any.

    """

    parts: tuple[MeshPart, ...]
    mean_rgb: Rgb = (1.0, 1.0, 1.0)

    @property
    def vertices_m(self) -> NDArray[np.float64]:
        """Of all parts, shape (n, 3)."""
        return np.concatenate([part.vertices_m for part in self.parts])


@dataclass(frozen=True, slots=True)
class Footprint:
    """Where an object stands: a rectangle about its middle, widened by a radius all around.

    A cube's has no radius, a ball's nothing but one.
    """

    half_ahead_m: float
    half_across_m: float
    radius_m: float = 0.0

    @property
    def reach_m(self) -> float:
        """Its farthest point from the middle."""
        return math.hypot(self.half_ahead_m, self.half_across_m) + self.radius_m

    def scaled(self, scale: float) -> "Footprint":
        """Of an object so many times as large."""
        return Footprint(
            self.half_ahead_m * scale, self.half_across_m * scale, self.radius_m * scale
        )


@dataclass(frozen=True, slots=True)
class TargetObject:
    """One kind of object. The default is the paper's, as far as it tells.

    Attributes:
        name: for people.
        shape: what it is.
        width_m: a cube's edge, a ball's or a cylinder's diameter, a mesh's wider side.
        height_m: above the floor; a cube's and a ball's is their width.
        colour_srgb: 0-255; the paper says only "a distinct object". Pictures are multiplied by it.
        texture: on each side; shape (side, side, 3), RGB. Not of a mesh, whose parts have theirs.
        mesh: its surface, if it is one.

    """

    name: str = "red cube"
    shape: Shape = Shape.CUBE
    width_m: float = 0.10
    height_m: float = 0.10
    colour_srgb: tuple[int, int, int] = (200, 30, 35)
    texture: Picture | None = field(default=None, compare=False)
    mesh: Mesh | None = field(default=None, compare=False)

    @property
    def rgb(self) -> Rgb:
        """Its colour."""
        red, green, blue = self.colour_srgb
        return red / 255, green / 255, blue / 255

    @property
    def is_plain(self) -> bool:
        """Whether it is of one colour all over."""
        parts = () if self.mesh is None else self.mesh.parts
        return self.texture is None and all(part.picture is None for part in parts)

    @property
    def mean_hsv(self) -> tuple[float, float, float]:
        """Hue, saturation and value of what it looks like from afar, each in [0, 1]."""
        rgb = np.array(self.rgb)
        if self.texture is not None:
            rgb = rgb * self.texture.reshape(-1, 3).mean(axis=0) / 255
        if self.mesh is not None:
            rgb = rgb * self.mesh.mean_rgb
        return colorsys.rgb_to_hsv(*rgb.tolist())

    @property
    def footprint(self) -> Footprint:
        """Where it stands; a mesh's is the rectangle around it."""
        half = self.width_m / 2
        if self.shape in (Shape.BALL, Shape.CYLINDER):
            return Footprint(0.0, 0.0, half)
        if self.mesh is not None:
            ahead, across = np.abs(self.mesh.vertices_m[:, :2]).max(axis=0).tolist()
            return Footprint(ahead, across)
        return Footprint(half, half)


RED_CUBE = TargetObject()
