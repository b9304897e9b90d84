"""The noise of an image sensor: no two frames of a real camera are the same."""

from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from mbot_protocol.drive.picture import Picture

READ_NOISE = 0.8
SHOT_NOISE = 0.12
"""Standard deviation in a dark picture, and per square root of brightness, of 255. Assumed: 0.8
to 2.1 over the range, what an IMX477 shows indoors at a low gain, where the JPEG hides the rest."""

SPARE_PX = 61
"""The stored noise is larger than a picture by this much; a prime, against patterns."""


class SensorNoise:
    """Adds read and shot noise.

    Drawing new random numbers for every pixel would cost more than drawing the picture, so a
    stored field of noise is laid over each picture at a random place.
    """

    def __init__(self, width_px: int, height_px: int, seed: int, strength: float = 1.0) -> None:
        self._rng = np.random.default_rng(seed)
        shape = (height_px + SPARE_PX, width_px + SPARE_PX, 3)
        self._field = self._rng.standard_normal(shape, np.float32)
        brightness = np.arange(256)
        self._deviation: NDArray[np.float32] = strength * np.sqrt(
            READ_NOISE**2 + SHOT_NOISE**2 * brightness
        ).astype(np.float32)

    def apply(self, picture: Picture, strength: float = 1.0) -> Picture:
        """A noisy copy. Shape (height_px, width_px, 3), uint8; `strength` is for this one."""
        height, width = picture.shape[:2]
        top, left = self._rng.integers(0, SPARE_PX + 1, 2)
        noise = self._field[top : top + height, left : left + width]
        scaled = cv2.multiply(cv2.LUT(picture, self._deviation * np.float32(strength)), noise)
        return cast(Picture, cv2.add(picture, scaled, dtype=cv2.CV_8U))
