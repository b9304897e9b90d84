"""The floor's picture: light vinyl with faint flecks, so that driving shows."""

from typing import cast

import cv2
import numpy as np

from mbot_protocol.picture import Picture

TILE_SIDE_PX = 256
TILE_SIDE_M = 1.0
VINYL_RGB = (196, 192, 184)
"""Light, a little warm; the paper's picture of the scene shows such a floor."""


def vinyl(seed: int) -> Picture:
    """One tile that repeats without a seam, with the joint of two sheets along one side.

    Returns:
        Shape (256, 256, 3), RGB.

    """
    rng = np.random.default_rng(seed)
    mottle = np.zeros((TILE_SIDE_PX, TILE_SIDE_PX))
    for cells, strength in ((8, 4.0), (32, 4.0), (128, 3.0)):
        # Wrapped by one cell before growing, so that opposite edges meet.
        coarse = np.pad(rng.normal(size=(cells, cells)), 1, mode="wrap")
        grown = cv2.resize(coarse, None, fx=(s := TILE_SIDE_PX / cells), fy=s)
        margin = int(s)
        mottle += strength * grown[margin:-margin, margin:-margin]
    tile = np.array(VINYL_RGB) + mottle[..., None]
    tile[:2] -= 22  # the joint of two sheets
    return cast(Picture, np.clip(tile, 0, 255).astype(np.uint8))
