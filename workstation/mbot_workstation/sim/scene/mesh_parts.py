"""A mesh as it is drawn: parts with a picture each, made of a GLB file's surfaces."""

from collections import defaultdict
from collections.abc import Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray

from mbot_protocol.drive.picture import Picture
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.sim.scene.glb_file import GlbSurface
from mbot_workstation.sim.scene.target_object import Mesh, MeshPart, Rgb

SMALLEST_M2 = 1e-12
"""A square micrometre: MuJoCo refuses parts without any area."""

PALETTE_PX = 128
"""Colours in a row of a palette; with one for each of the most triangles it has 157 rows."""

WHITE = (255, 255, 255)

_INSIDE = np.array([c for c in product(range(1, 11, 3), repeat=3) if sum(c) == 12]) / 12
"""Places all over a triangle: weights of its corners, shape (10, 3)."""


def made_mesh(
    surfaces: Sequence[GlbSurface],
    height_m: float,
    texture: Picture | None = None,
    *,
    keep_colours: bool = True,
) -> tuple[Mesh, tuple[int, int, int]]:
    """A mesh, and its colour if it is of one all over, else white.

    Surfaces of several colours become one part whose picture is their palette; a triangle is of
    the mean colour of its corners.

    Args:
        surfaces: of a file, at least one.
        height_m: what they are scaled to.
        texture: on all of them, in place of what is there.
        keep_colours: otherwise what has no picture is white.

    Raises:
        ConfigurationError: they do not stand, or a picture has no place on them.

    """
    pictured: defaultdict[int, list[MeshPart]] = defaultdict(list)
    plain: list[MeshPart] = []
    shades: list[Picture] = []
    for surface, vertices_m in zip(surfaces, _placed(surfaces, height_m), strict=True):
        kept = _areas_m2(vertices_m, surface.triangles) > SMALLEST_M2
        part = MeshPart(vertices_m, surface.triangles[kept])
        if texture is None and surface.material.picture is None:
            plain.append(part)
            shades.append(_shades(surface, part.triangles, keep=keep_colours))
        else:
            group = pictured[0 if texture is not None else id(surface.material)]
            group.append(_pictured(surface, part, texture))
    parts = [_joined(group) for group in pictured.values()]
    if plain:
        whole, colours = _joined(plain), np.concatenate(shades)
        if not parts and len(colours) and (colours == colours[0]).all():
            red, green, blue = colours[0].tolist()
            return Mesh((whole,)), (red, green, blue)
        parts.append(_with_palette(whole, colours))
    parts = [part for part in parts if len(part.triangles)]
    if not parts:
        raise ConfigurationError("is flat or not finite, expected something that stands")
    return Mesh(tuple(parts), _mean_rgb(parts)), WHITE


def _placed(surfaces: Sequence[GlbSurface], height_m: float) -> list[NDArray[np.float64]]:
    """Their vertices in m, as `Mesh` has them."""
    turned = [surface.vertices[:, (2, 0, 1)] for surface in surfaces]  # glTF's y is up
    every = np.concatenate(turned)
    low, high = every.min(axis=0), every.max(axis=0)
    if not np.isfinite(every).all() or min(high - low) <= 0:
        raise ConfigurationError("is flat or not finite, expected something that stands")
    middle = np.array([*(low + high)[:2] / 2, low[2]])
    return [(vertices - middle) * (height_m / (high - low)[2]) for vertices in turned]


def _areas_m2(vertices_m: NDArray[np.float64], triangles: NDArray[np.int32]) -> NDArray[np.float64]:
    first, second, third = vertices_m[triangles].transpose(1, 0, 2)
    return np.linalg.norm(np.cross(second - first, third - first), axis=1) / 2


def _shades(surface: GlbSurface, triangles: NDArray[np.int32], *, keep: bool) -> Picture:
    """The colour of each triangle, shape (m, 3)."""
    light = np.ones((len(triangles), 3))
    if keep:
        light *= surface.material.factor
        if surface.colours is not None:
            light *= surface.colours[triangles].mean(axis=1)
    return _srgb(light)


def _pictured(surface: GlbSurface, part: MeshPart, texture: Picture | None) -> MeshPart:
    if surface.uv is None:
        raise ConfigurationError(
            "does not say where a picture goes (no UV), give it a colour instead"
        )
    picture = texture
    if texture is None and surface.material.picture is not None:
        if surface.colours is not None and (surface.colours < 1).any():
            raise ConfigurationError(
                "has a picture and colours of corners on the same surface: paint them into the "
                "picture, or leave them away"
            )
        picture = _srgb(_light(surface.material.picture) * surface.material.factor)
    return MeshPart(part.vertices_m, part.triangles, picture, surface.uv[part.triangles])


def _joined(parts: Sequence[MeshPart]) -> MeshPart:
    """As one, with the picture of the first."""
    before = np.cumsum([0, *(len(part.vertices_m) for part in parts)])
    uv = [part.corners_uv for part in parts if part.corners_uv is not None]
    return MeshPart(
        np.concatenate([part.vertices_m for part in parts]),
        np.concatenate([p.triangles + n for p, n in zip(parts, before[:-1], strict=True)]),
        parts[0].picture,
        np.concatenate(uv) if uv else None,
    )


def _with_palette(part: MeshPart, colours: Picture) -> MeshPart:
    """Each triangle in the middle of a pixel of its colour."""
    own, which = np.unique(colours, axis=0, return_inverse=True)
    rows = -(-len(own) // PALETTE_PX)
    columns = min(len(own), PALETTE_PX)
    palette = np.zeros((rows * columns, 3), np.uint8)
    palette[: len(own)] = own
    row, column = np.divmod(which.ravel(), columns)
    uv = np.stack([(column + 0.5) / columns, (row + 0.5) / rows], axis=-1)
    corners_uv = np.repeat(uv[:, None], 3, axis=1)
    return MeshPart(part.vertices_m, part.triangles, palette.reshape(rows, columns, 3), corners_uv)


def _mean_rgb(parts: Sequence[MeshPart]) -> Rgb:
    weighted, area_m2 = np.zeros(3), 0.0
    for part in parts:
        if part.picture is None or part.corners_uv is None:
            continue
        rows, columns = part.picture.shape[:2]
        places = (_INSIDE @ part.corners_uv) % 1 * (columns, rows)
        column, row = np.minimum(places.astype(int), (columns - 1, rows - 1)).transpose(2, 0, 1)
        areas = _areas_m2(part.vertices_m, part.triangles)
        weighted += areas @ part.picture[row, column].mean(axis=1)
        area_m2 += areas.sum()
    red, green, blue = (weighted / area_m2 / 255).tolist()
    return red, green, blue


def _light(picture: Picture) -> NDArray[np.float64]:
    """sRGB to linear, as IEC 61966-2-1 has it."""
    share = picture / 255
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)


def _srgb(light: NDArray[np.float64]) -> Picture:
    """And back."""
    light = np.clip(light, 0, 1)
    share = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return np.rint(255 * share).astype(np.uint8)
