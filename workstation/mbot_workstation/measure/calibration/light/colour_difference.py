"""How different two colours look: sRGB to CIELAB, and CIEDE2000 between them.

CIEDE2000: Sharma, Wu, Dalal, "The CIEDE2000 color-difference formula: implementation notes,
supplementary test data, and mathematical observations", Color Research and Application 30 (2005).
Variable names follow it.
"""

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

Values = NDArray[np.float64]

_FULL_TURN = 360.0
_BEND = 25.0**7


def srgb_level(reflectance: float) -> float:
    """The sRGB level, 0 to 255, of a surface that reflects this share of the light on it."""
    if reflectance <= 0.0031308:
        return 255 * 12.92 * reflectance
    return 255 * (1.055 * reflectance ** (1 / 2.4) - 0.055)


def lab(srgb: ArrayLike) -> Values:
    """CIELAB of sRGB levels.

    Args:
        srgb: shape (..., 3), 0 to 255.

    Returns:
        L, a, b, the same shape; D65.

    """
    share = np.asarray(srgb, np.float64) / 255
    pixels = share.reshape(-1, 1, 3).astype(np.float32)
    return cv2.cvtColor(pixels, cv2.COLOR_RGB2Lab).astype(np.float64).reshape(share.shape)


def ciede2000(one: ArrayLike, other: ArrayLike) -> Values:
    """The difference of CIELAB colours; about 1 is just visible, 100 is black against white.

    Args:
        one, other: shape (..., 3).

    Returns:
        Shape (...).

    """
    l1, a1, b1 = np.moveaxis(np.asarray(one, np.float64), -1, 0)
    l2, a2, b2 = np.moveaxis(np.asarray(other, np.float64), -1, 0)
    mean_c = (np.hypot(a1, b1) + np.hypot(a2, b2)) / 2
    g = 0.5 * (1 - np.sqrt(mean_c**7 / (mean_c**7 + _BEND)))
    c1, c2 = np.hypot((1 + g) * a1, b1), np.hypot((1 + g) * a2, b2)
    h1 = np.degrees(np.arctan2(b1, (1 + g) * a1)) % _FULL_TURN
    h2 = np.degrees(np.arctan2(b2, (1 + g) * a2)) % _FULL_TURN
    has_hue = c1 * c2 != 0

    apart = h2 - h1
    apart = np.where(apart > 180, apart - 360, np.where(apart < -180, apart + 360, apart))
    apart = np.where(has_hue, apart, 0)
    delta_l, delta_c = l2 - l1, c2 - c1
    delta_h = 2 * np.sqrt(c1 * c2) * np.sin(np.radians(apart / 2))

    mean_l, mean_c = (l1 + l2) / 2, (c1 + c2) / 2
    total = h1 + h2
    far = np.abs(h1 - h2) > 180
    mean_h = np.where(far, np.where(total < 360, total + 360, total - 360), total) / 2
    mean_h = np.where(has_hue, mean_h, total)
    t = (
        1
        - 0.17 * _cos(mean_h - 30)
        + 0.24 * _cos(2 * mean_h)
        + 0.32 * _cos(3 * mean_h + 6)
        - 0.20 * _cos(4 * mean_h - 63)
    )
    s_l = 1 + 0.015 * (mean_l - 50) ** 2 / np.sqrt(20 + (mean_l - 50) ** 2)
    s_c = 1 + 0.045 * mean_c
    s_h = 1 + 0.015 * mean_c * t
    turn = 30 * np.exp(-(((mean_h - 275) / 25) ** 2))
    r_t = -2 * np.sqrt(mean_c**7 / (mean_c**7 + _BEND)) * np.sin(np.radians(2 * turn))
    lightness, chroma, hue = delta_l / s_l, delta_c / s_c, delta_h / s_h
    return np.sqrt(lightness**2 + chroma**2 + hue**2 + r_t * chroma * hue)


def _cos(degrees: Values) -> Values:
    return np.cos(np.radians(degrees))
