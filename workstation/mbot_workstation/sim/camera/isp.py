"""From light to a camera's picture: what an image signal processor (ISP) does.

Automatic exposure and white balance that lag, vignetting, a tone curve, saturation, sharpening,
noise and JPEG; one model for the pictures that policies are trained on and for the virtual
robot's camera. Works on pictures of any size.
"""

import math
from dataclasses import dataclass
from typing import cast

import cv2
import numpy as np
from numpy.typing import NDArray

from mbot_protocol.drive.picture import Picture
from mbot_workstation.sim.camera.sensor_noise import SensorNoise

DISPLAY_GAMMA = 2.2
"""Pictures are drawn in display levels; light is their 2.2th power (sRGB, nearly)."""

WHITE = 4.0
"""Light beyond which a filmic curve shows white, of what a plain one shows as white."""

DRIFT_PERIOD_S = 20.0
"""An automatic exposure that hunts, clouds; assumed."""

_MOST_STOPS = math.log(8.0)
"""An automatic exposure reaches from an eighth to eight times the light of a plain one; assumed,
what exposure time and analogue gain of an IMX477 indoors have left."""

_MOST_BALANCE = math.log(2.0)
"""And a white balance from half to twice; daylight to lamp light."""


@dataclass(frozen=True, slots=True)
class IspSettings:
    """One camera's processing. The defaults leave pictures as they are.

    Attributes:
        gains: of red, green and blue, on display levels: a fixed exposure and white balance.
        exposure_drift: share by which the gain swings up and down over 20 s.
        auto_exposure: how much of the way to its target the exposure goes, in [0, 1].
        exposure_target: the mean display level it aims at, in (0, 1).
        auto_exposure_lag_s: time constant with which it follows.
        auto_white_balance: how much of a picture's tint is taken away, in [0, 1].
        auto_white_balance_lag_s: time constant.
        vignetting: share of the light that is missing in the corners.
        filmic: how much of a filmic curve's shoulder there is, in [0, 1].
        contrast: how much of an S-curve, in [-1, 1].
        black_level: display level of black, in [-0.1, 0.2]; below 0 it is crushed.
        saturation: of colours; 1 leaves them.
        sharpening: strength of the unsharp mask.
        noise: of the sensor; 1 is `SensorNoise`'s.
        chroma_noise: of colours in blotches, standard deviation in levels of 255.
        jpeg_quality: 1-100; 100 leaves the coder out.

    """

    gains: tuple[float, float, float] = (1.0, 1.0, 1.0)
    exposure_drift: float = 0.0
    auto_exposure: float = 0.0
    exposure_target: float = 0.45
    auto_exposure_lag_s: float = 0.5
    auto_white_balance: float = 0.0
    auto_white_balance_lag_s: float = 1.0
    vignetting: float = 0.0
    filmic: float = 0.0
    contrast: float = 0.0
    black_level: float = 0.0
    saturation: float = 1.0
    sharpening: float = 0.0
    noise: float = 0.0
    chroma_noise: float = 0.0
    jpeg_quality: float = 100.0

    @property
    def has_curve(self) -> bool:
        """Whether levels change other than by gains."""
        return bool(
            self.auto_exposure
            or self.auto_white_balance
            or self.filmic
            or self.contrast
            or self.black_level
        )


class ImageSignalProcessor:
    """One camera's processing, with what its automatics remember."""

    def __init__(
        self, width_px: int, height_px: int, noise_seed: int, noise_share: float = 1.0
    ) -> None:
        """Prepare for pictures of one size.

        Args:
            width_px, height_px: the size.
            noise_seed: of the sensor.
            noise_share: how much of a full frame's noise is in these pictures.

        """
        self._size = width_px, height_px
        self._noise_share = noise_share
        self._noise = SensorNoise(width_px, height_px, noise_seed, noise_share)
        self._blotches = _Blotches(width_px, height_px, noise_seed + 1)
        self.become(IspSettings())
        self.restart(0.0)

    def become(self, settings: IspSettings) -> None:
        """Be another camera."""
        self._settings = settings
        self._tone = _ToneCurve(settings)
        self._falloff = _falloff(*self._size, settings.vignetting)
        self._saturate = _saturation(settings.saturation)

    def restart(self, drift_phase_rad: float) -> None:
        """Forget what the automatics have seen, and begin somewhere in the exposure's swing."""
        self._drift_phase_rad = drift_phase_rad
        self._log_gains: NDArray[np.float64] | None = None
        self._last_s = 0.0

    def process(self, light: Picture, time_s: float) -> Picture:
        """What the camera makes of the light.

        Args:
            light: shape (height_px, width_px, 3), RGB, as drawn.
            time_s: of the picture, on a clock that starts with `restart`.

        Returns:
            The same shape; may be `light` itself.

        """
        settings, picture = self._settings, light
        if self._falloff is not None:
            picture = cast(Picture, cv2.multiply(picture, self._falloff, dtype=cv2.CV_8U))
        picture = self._expose(picture, time_s)
        if self._saturate is not None:
            picture = cast(Picture, cv2.transform(picture, self._saturate))
        if settings.noise > 0:
            picture = self._noise.apply(picture, settings.noise)
        if settings.chroma_noise > 0:
            picture = self._blotches.apply(picture, settings.chroma_noise)
        if settings.sharpening > 0:
            soft = cv2.GaussianBlur(picture, (0, 0), 0.8)
            strength = settings.sharpening
            picture = cast(Picture, cv2.addWeighted(picture, 1 + strength, soft, -strength, 0))
        return picture if settings.jpeg_quality >= 100 else _coded(picture, settings.jpeg_quality)

    def _expose(self, picture: Picture, time_s: float) -> Picture:
        settings = self._settings
        swing = 1.0
        if settings.exposure_drift > 0:
            angle = 2 * math.pi * time_s / DRIFT_PERIOD_S + self._drift_phase_rad
            swing += settings.exposure_drift * math.sin(angle)
        if not settings.has_curve and swing == 1.0 and settings.gains == (1.0, 1.0, 1.0):
            return picture
        gains = np.array(settings.gains) * swing
        if not settings.has_curve:
            return cast(Picture, cv2.LUT(picture, _plain_levels(gains)))
        light_gains = gains**DISPLAY_GAMMA * np.exp(self._follow(picture, gains, time_s))
        return cast(Picture, cv2.LUT(picture, self._tone.levels(light_gains)))

    def _follow(
        self, picture: Picture, gains: NDArray[np.float64], time_s: float
    ) -> NDArray[np.float64]:
        """The automatics' gains on light by now, as logarithms. Shape (3,)."""
        settings = self._settings
        means = np.maximum(np.array(cv2.mean(picture)[:3]) / 255 * gains, 1e-3)
        luma = float(means @ (0.299, 0.587, 0.114))
        stops = settings.auto_exposure * DISPLAY_GAMMA * math.log(settings.exposure_target / luma)
        tint = settings.auto_white_balance * DISPLAY_GAMMA * np.log(means[1] / means)
        wanted = (
            np.array([min(max(stops, -_MOST_STOPS), _MOST_STOPS)]),
            tint.clip(-_MOST_BALANCE, _MOST_BALANCE),
        )
        passed_s = max(time_s - self._last_s, 0.0)
        self._last_s = time_s
        if self._log_gains is None:
            self._log_gains = np.concatenate(wanted)
        else:
            lags = np.array(
                [settings.auto_exposure_lag_s, *3 * [settings.auto_white_balance_lag_s]]
            )
            share = 1 - np.exp(-passed_s / np.maximum(lags, 1e-3))
            self._log_gains = self._log_gains + share * (np.concatenate(wanted) - self._log_gains)
        return self._log_gains[0] + self._log_gains[1:]


class _ToneCurve:
    """From light to display levels, tabulated."""

    _STEPS = 4096
    _MOST = 16.0

    def __init__(self, settings: IspSettings) -> None:
        # Even in the fourth root of light, where the eye and the levels are.
        light = (np.linspace(0, 1, self._STEPS) ** 4) * self._MOST
        filmic = light * (1 + light / WHITE**2) / (1 + light)  # Reinhard's, 1 at WHITE
        shown = (1 - settings.filmic) * np.minimum(light, 1) + settings.filmic * filmic
        level = np.clip(shown, 0, 1) ** (1 / DISPLAY_GAMMA)
        level += settings.contrast * (level * level * (3 - 2 * level) - level)
        level = settings.black_level + (1 - settings.black_level) * level
        self._table = np.clip(level * 255 + 0.5, 0, 255).astype(np.uint8)
        self._roots = (np.arange(256) / 255) ** (DISPLAY_GAMMA / 4)

    def levels(self, light_gains: NDArray[np.float64]) -> NDArray[np.uint8]:
        """The output level for each input level and channel. Shape (1, 256, 3)."""
        roots = self._roots[:, None] * (light_gains / self._MOST) ** 0.25
        index = np.minimum(roots * (self._STEPS - 1), self._STEPS - 1).astype(np.intp)
        return self._table[index][None]


def _plain_levels(gains: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Gains on display levels, clipped at 255. Shape (1, 256, 3)."""
    scaled = np.arange(256)[:, None] * gains
    return np.minimum(scaled + 0.5, 255).astype(np.uint8)[None]


def _falloff(width_px: int, height_px: int, vignetting: float) -> NDArray[np.float32] | None:
    """Share of the display level that is left at each pixel. Shape (h, w, 3)."""
    if vignetting <= 0:
        return None
    x = (np.arange(width_px) + 0.5) / width_px * 2 - 1
    y = (np.arange(height_px) + 0.5) / height_px * 2 - 1
    light = 1 - vignetting * (x[None] ** 2 + y[:, None] ** 2) / 2
    return np.repeat(light[..., None] ** (1 / DISPLAY_GAMMA), 3, axis=2).astype(np.float32)


def _saturation(saturation: float) -> NDArray[np.float32] | None:
    """The matrix that moves colours away from their grey. Shape (3, 3)."""
    if saturation == 1:
        return None
    grey = np.tile((0.299, 0.587, 0.114), (3, 1))
    return (saturation * np.eye(3) + (1 - saturation) * grey).astype(np.float32)


class _Blotches:
    """Noise in the colours only, a few pixels wide, as noise reduction leaves it."""

    _SPARE_PX = 37

    def __init__(self, width_px: int, height_px: int, seed: int) -> None:
        self._rng = np.random.default_rng(seed)
        shape = height_px + self._SPARE_PX, width_px + self._SPARE_PX, 3
        field = cv2.GaussianBlur(self._rng.standard_normal(shape).astype(np.float32), (0, 0), 1.5)
        field -= field @ np.array((0.299, 0.587, 0.114), np.float32)[:, None]
        self._field = field / field.std()

    def apply(self, picture: Picture, strength: float) -> Picture:
        height, width = picture.shape[:2]
        top, left = self._rng.integers(0, self._SPARE_PX + 1, 2)
        part = self._field[top : top + height, left : left + width]
        return cast(Picture, cv2.add(picture, part * np.float32(strength), dtype=cv2.CV_8U))


def _coded(picture: Picture, quality: float) -> Picture:
    """Through a JPEG coder and back."""
    bgr = cv2.cvtColor(picture, cv2.COLOR_RGB2BGR)
    _, coded = cv2.imencode(
        ".jpg",
        bgr,
        [
            *(cv2.IMWRITE_JPEG_QUALITY, round(quality)),
            *(cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444),
        ],
    )
    decoded = cast(Picture, cv2.imdecode(coded, cv2.IMREAD_COLOR))
    return cast(Picture, cv2.cvtColor(decoded, cv2.COLOR_BGR2RGB))
