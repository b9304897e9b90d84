"""Pictures of floors that repeat without a seam: the nominal vinyl, and made-up others.

All are procedural: a seed gives a floor. Colours and patterns are assumptions about what homes,
schools and offices have.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from mbot_protocol.drive.picture import Picture

SIDE_PX = 256
VINYL_RGB = (196, 192, 184)
"""Light, a little warm; the paper's picture of the scene shows such a floor."""

Light = NDArray[np.float64]
"""A picture as it is drawn: shape (256, 256, 3), levels that may leave 0-255."""


@dataclass(frozen=True, slots=True, eq=False)
class FloorTexture:
    """One tile of a floor.

    Attributes:
        picture: shape (h, w, 3), RGB; opposite edges meet.
        side_m: how long the tile is on the floor.

    """

    picture: Picture
    side_m: float


def vinyl(seed: int = 0) -> FloorTexture:
    """The nominal floor: light, with faint flecks and the joint of two sheets along one side."""
    rng = np.random.default_rng(seed)
    tile = np.array(VINYL_RGB) + _mottle(rng, ((8, 4.0), (32, 4.0), (128, 3.0)))
    tile[:2] -= 22  # the joint of two sheets
    return _finished(tile, 1.0)


def made_up_floor(seed: int) -> FloorTexture:
    """Some floor: tiles, boards, carpet, concrete, a checkerboard, or vinyl with lines."""
    rng = np.random.default_rng(seed)
    return _KINDS[seed % len(_KINDS)](rng)


HOME_KINDS = 8
"""Further floors, of homes and halls: parquet, clay tiles, terrazzo, dark and light tiles."""


def home_floor(seed: int) -> FloorTexture:
    """One of those."""
    rng = np.random.default_rng(seed)
    kinds = (_parquet, _clay, _terrazzo, _large_tiles)
    return kinds[seed % len(kinds)](rng)


def _parquet(rng: np.random.Generator) -> FloorTexture:
    """Short boards that lie across each other in squares."""
    wood = rng.uniform(0.3, 1.05) * np.array([205.0, 150.0, 95.0]) + rng.normal(0, 8, 3)
    grain = cv2.GaussianBlur(rng.normal(0, 30, (SIDE_PX, SIDE_PX)), (0, 0), 8, sigmaY=0.6)
    grain = np.asarray(grain, np.float64)
    half = SIDE_PX // 2
    tile = np.zeros((SIDE_PX, SIDE_PX, 3))
    for row in (0, 1):
        for column in (0, 1):
            square = slice(row * half, (row + 1) * half), slice(column * half, (column + 1) * half)
            lines = grain[square] if (row + column) % 2 else grain[square].T
            tile[square] = wood + lines[..., None] + rng.normal(0, 7)
            for start in range(0, half, half // 4):
                board = (slice(start, start + 2), slice(None))
                tile[square][board if (row + column) % 2 else board[::-1]] -= 30
    return _finished(tile, rng.uniform(0.3, 0.9))


def _clay(rng: np.random.Generator) -> FloorTexture:
    """Terracotta: reddish tiles with light joints."""
    clay = rng.uniform(0.6, 1.1) * np.array([178.0, 108.0, 78.0])
    tile = clay + _mottle(rng, ((4, 12.0), (16, 8.0), (128, 4.0)))
    width = int(rng.integers(3, 8))
    tile[:width] = tile[:, :width] = rng.uniform(120, 200) * np.array([1.0, 0.97, 0.92])
    return _finished(tile, rng.uniform(0.15, 0.4))


def _terrazzo(rng: np.random.Generator) -> FloorTexture:
    """Chips of stone in cement, large or small."""
    tile = np.clip(_base(rng) + np.zeros((SIDE_PX, SIDE_PX, 3)), 0, 255)
    for _ in range(int(rng.integers(60, 400))):
        x, y = (int(one) for one in rng.integers(8, SIDE_PX - 8, 2))
        colour = (rng.uniform(60, 230) * (1 + rng.uniform(-0.12, 0.12, 3))).tolist()
        cv2.ellipse(
            tile, (x, y), (int(rng.integers(1, 7)), int(rng.integers(1, 5))),
            rng.uniform(0, 180), 0, 360, colour, -1,
        )  # fmt: skip
    return _finished(tile, rng.uniform(0.3, 1.2))


def _large_tiles(rng: np.random.Generator) -> FloorTexture:
    """Black to white stone with fine joints."""
    grey = rng.choice([rng.uniform(15, 60), rng.uniform(60, 235)])
    tile = grey * (1 + rng.uniform(-0.06, 0.06, 3))[None, None]
    tile = tile + _mottle(rng, ((4, 7.0), (16, 5.0), (64, 3.0)))
    tile[:2] = tile[:, :2] = rng.uniform(40, 160)
    return _finished(tile, rng.uniform(0.3, 0.8))


def _tiles(rng: np.random.Generator) -> FloorTexture:
    count = int(rng.integers(1, 4))
    tile = _base(rng) + _mottle(rng, ((4, 6.0), (32, 4.0), (128, 3.0)))
    shades = rng.normal(0, 5, (count, count)).astype(np.float32)
    size = (SIDE_PX, SIDE_PX)
    tile = tile + cv2.resize(shades, size, interpolation=cv2.INTER_NEAREST)[..., None]
    joint = rng.uniform(-90, 40)
    width = int(rng.integers(2, 6))
    for start in np.linspace(0, SIDE_PX, count, endpoint=False).astype(int):
        tile[start : start + width] += joint
        tile[:, start : start + width] += joint
    return _finished(tile, count * rng.uniform(0.2, 0.6))


def _boards(rng: np.random.Generator) -> FloorTexture:
    wood = rng.uniform(0.35, 1.1) * np.array([200.0, 155.0, 110.0]) + rng.normal(0, 10, 3)
    rows = int(rng.choice([4, 8]))
    high = SIDE_PX // rows
    grain = cv2.GaussianBlur(rng.normal(0, 26, (SIDE_PX, SIDE_PX)), (0, 0), 9, sigmaY=0.6)
    tile = wood + _wrapped(np.asarray(grain, np.float64))[..., None]
    for row in range(rows):
        tile[row * high : (row + 1) * high] += rng.normal(0, 9)
        tile[row * high : row * high + 2] -= 35
        end = int(rng.integers(SIDE_PX - 2))
        tile[row * high : (row + 1) * high, end : end + 2] -= 30
    return _finished(tile, rows * rng.uniform(0.07, 0.2))


def _carpet(rng: np.random.Generator) -> FloorTexture:
    pile = rng.normal(0, rng.uniform(8, 22), (SIDE_PX, SIDE_PX, 1))
    tile = _base(rng, saturated=0.5) + _mottle(rng, ((8, 4.0), (64, 8.0))) + pile
    return _finished(tile, rng.uniform(0.4, 1.2))


def _concrete(rng: np.random.Generator) -> FloorTexture:
    blotches = ((4, 14.0), (8, 10.0), (32, 6.0), (128, 4.0))
    return _finished(_base(rng) + _mottle(rng, blotches), rng.uniform(1.0, 2.5))


def _checkerboard(rng: np.random.Generator) -> FloorTexture:
    one, other = _base(rng), _base(rng)
    cell = np.kron([[0, 1], [1, 0]], np.ones((SIDE_PX // 2, SIDE_PX // 2)))[..., None]
    tile = np.where(cell == 0, one, other) + _mottle(rng, ((32, 4.0),))
    return _finished(tile, 2 * rng.uniform(0.15, 0.5))


def _lined(rng: np.random.Generator) -> FloorTexture:
    """Vinyl, or a gymnasium's floor, with a stripe of tape or paint each way."""
    tile = _base(rng) + _mottle(rng, ((8, 4.0), (64, 4.0)))
    for axis in (0, 1):
        start, width = int(rng.integers(SIDE_PX - 16)), int(rng.integers(3, 14))
        stripe = tile[start : start + width] if axis == 0 else tile[:, start : start + width]
        stripe[:] = rng.uniform(20, 235, 3)
    return _finished(tile, rng.uniform(1.0, 3.0))


_KINDS: tuple[Callable[[np.random.Generator], FloorTexture], ...] = (
    _tiles,
    _boards,
    _carpet,
    _concrete,
    _checkerboard,
    _lined,
)


def _base(rng: np.random.Generator, saturated: float = 0.25) -> Light:
    """A colour from dark to light, mostly greyish: shape (1, 1, 3)."""
    grey = rng.uniform(55, 225)
    return (grey * (1 + saturated * rng.uniform(-0.6, 0.6, 3)))[None, None]


def _mottle(rng: np.random.Generator, layers: tuple[tuple[int, float], ...]) -> Light:
    """Noise of several sizes, shape (256, 256, 1): for each layer, cells a side and strength."""
    total = np.zeros((SIDE_PX, SIDE_PX))
    for cells, strength in layers:
        # Wrapped by one cell before growing, so that opposite edges meet.
        coarse = np.pad(rng.normal(size=(cells, cells)), 1, mode="wrap")
        grown = cv2.resize(coarse, None, fx=(s := SIDE_PX / cells), fy=s)
        margin = int(s)
        total += strength * grown[margin:-margin, margin:-margin]
    return total[..., None]


def _wrapped(picture: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same with edges that meet: blended into itself, moved by half."""
    ramp = np.abs(np.linspace(-1, 1, SIDE_PX))
    weight = np.maximum(ramp[:, None], ramp[None, :]) ** 4
    half = SIDE_PX // 2
    return picture * (1 - weight) + np.roll(picture, (half, half), (0, 1)) * weight


def _finished(tile: Light, side_m: float) -> FloorTexture:
    return FloorTexture(cast(Picture, np.clip(tile, 0, 255).astype(np.uint8)), float(side_m))
