"""Exposure and white balance as a table from level to level."""

import numpy as np
from numpy.typing import NDArray


def levels(gains: tuple[float, ...]) -> NDArray[np.uint8]:
    """The output level for each input level and channel, clipped at 255.

    Args:
        gains: of red, green and blue.

    Returns:
        Shape (1, 256, 3), for OpenCV's LUT.

    """
    scaled = np.arange(256)[:, None] * np.array(gains)
    return np.minimum(scaled + 0.5, 255).astype(np.uint8)[None]
