"""What surfaces look like close up: pictures that a thing's colour is multiplied with."""

import cv2
import numpy as np
from numpy.typing import NDArray

from mbot_protocol.drive.picture import Picture

SIDE_PX = 64
FINISHES = 8
"""0 is clean, 1 and 2 are scuffed, then wood, felt, cardboard, dirt and print."""

Grey = NDArray[np.float64]
"""Shares of 255, shape (64, 64)."""


def finish(index: int) -> Picture:
    """One of `FINISHES`: shape (64, 64, 3), RGB, all greys; the clean one is smaller."""
    if index == 0:
        return np.full((4, 4, 3), 255, np.uint8)
    rng = np.random.default_rng(index)
    made = (_scuffed, _scuffed, _wood, _felt, _cardboard, _dirty, _printed)[index - 1](rng)
    level = (255 * np.clip(made, 0, 1)).astype(np.uint8)
    return np.repeat(level[..., None], 3, axis=2)


def _clouds(rng: np.random.Generator, cells: tuple[int, int]) -> Grey:
    """Smooth noise of so many cells down and across, about 0 to 1."""
    size = (SIDE_PX, SIDE_PX)
    grown = cv2.resize(rng.uniform(0, 1, cells), size, interpolation=cv2.INTER_CUBIC)
    return np.asarray(grown, np.float64)


def _scuffed(rng: np.random.Generator) -> Grey:
    """Dirt in blotches, and darker edges."""
    level = 1 - 70 / 255 * np.clip(_clouds(rng, (8, 8)), 0, 1)
    return np.where(_from_edge() < rng.integers(1, 4), level * 0.75, level)


def _from_edge() -> NDArray[np.int64]:
    """How many pixels each is from the nearest edge."""
    along = np.arange(SIDE_PX)
    inward = np.minimum(along, along[::-1])
    return np.minimum.outer(inward, inward)


def _wood(rng: np.random.Generator) -> Grey:
    return 0.72 + 0.28 * _clouds(rng, (24, 3)) - 0.12 * (_clouds(rng, (48, 2)) > 0.75)


def _felt(rng: np.random.Generator) -> Grey:
    return 0.85 + rng.normal(0, 0.09, (SIDE_PX, SIDE_PX)) - 0.08 * _clouds(rng, (5, 5))


def _cardboard(rng: np.random.Generator) -> Grey:
    """Corrugated, with a flap's joint and crushed edges."""
    level = 0.9 + 0.03 * np.sin(np.arange(SIDE_PX) * 1.6)[None] - 0.1 * _clouds(rng, (6, 6))
    level[SIDE_PX // 2 - 1 : SIDE_PX // 2 + 1] *= 0.6
    return np.where(_from_edge() < 2, level * 0.8, level)


def _dirty(rng: np.random.Generator) -> Grey:
    return 1 - 0.5 * np.clip(_clouds(rng, (4, 4)), 0, 1) ** 2 - 0.15 * _clouds(rng, (16, 16))


def _printed(rng: np.random.Generator) -> Grey:
    """Lines of something written, and a mark."""
    level = np.ones((SIDE_PX, SIDE_PX))
    for row in range(12, 40, 7):
        level[row : row + 3, 10 : int(rng.integers(30, 56))] = 0.35
    cv2.circle(level, (44, 50), 7, 0.3, -1)
    return level
