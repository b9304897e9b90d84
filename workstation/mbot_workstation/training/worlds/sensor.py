"""From light to numbers: brightness, white balance, noise and JPEG of an observation."""

import math
from typing import cast

import cv2

from mbot_protocol.picture import Picture
from mbot_protocol.policy_contract import OBSERVATION_SIDE_PX
from mbot_workstation.simulation.colour_levels import levels
from mbot_workstation.simulation.sensor_noise import SensorNoise
from mbot_workstation.variation.effects import RealWorldEffects

FRAME_PX = 320 * 240
"""Of the camera's frames, which `Observer` averages: an observation's noise is that much less."""

NOISE_SHARE = math.sqrt(OBSERVATION_SIDE_PX**2 / FRAME_PX)
"""Checked: noise of strength 1, 3, 5 in frames leaves 0.55, 1.21, 1.94 grey levels RMS in
observations, and this 0.45, 1.23, 2.02."""

JPEG_SHARE = 0.25
"""A coder at quality q harms a frame's observation as one at 100 - 0.25 (100 - q) harms the
observation itself: quality 90, 80, 60 of frames leave 2.1, 2.8, 4.2 grey levels RMS in the cube's
redness, and 97, 95, 90 of observations 2.0, 2.8, 4.4 (measured)."""

DRIFT_PERIOD_S = 20.0
"""An automatic exposure that hunts, clouds; assumed."""


class Sensor:
    """The camera's sensor for one robot; its noise goes on from episode to episode.

    Attributes:
        drift_phase_rad: where in its swing the exposure is at the episode's start.

    """

    def __init__(self, seed: int) -> None:
        self.drift_phase_rad = 0.0
        self._noise = SensorNoise(OBSERVATION_SIDE_PX, OBSERVATION_SIDE_PX, seed, NOISE_SHARE)
        self.become(RealWorldEffects())

    def become(self, effects: RealWorldEffects) -> None:
        """Be the sensor of the robot with these effects."""
        self._effects = effects
        balance = (effects.red_gain, 1.0, effects.blue_gain)
        self._gains = tuple(effects.exposure_gain * gain for gain in balance)
        self._is_tinted = effects.exposure_drift > 0 or self._gains != (1.0, 1.0, 1.0)
        self._levels = levels(self._gains)
        quality = round(100 - JPEG_SHARE * (100 - effects.jpeg_quality))
        self._coder = [
            *(cv2.IMWRITE_JPEG_QUALITY, quality),
            *(cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444),
        ]

    def record(self, light: Picture, time_s: float) -> Picture:
        """What the sensor makes of an observation's light.

        Args:
            light: shape (64, 64, 3), RGB.
            time_s: since the episode's start.

        Returns:
            The same shape; may be `light` itself.

        """
        effects = self._effects
        picture = light
        if self._is_tinted:
            if effects.exposure_drift > 0:
                angle = 2 * math.pi * time_s / DRIFT_PERIOD_S + self.drift_phase_rad
                swing = 1 + effects.exposure_drift * math.sin(angle)
                self._levels = levels(tuple(gain * swing for gain in self._gains))
            picture = cast(Picture, cv2.LUT(picture, self._levels))
        if effects.noise > 0:
            picture = self._noise.apply(picture, effects.noise)
        if effects.jpeg_quality < 100:
            bgr = cv2.cvtColor(picture, cv2.COLOR_RGB2BGR)
            _, coded = cv2.imencode(".jpg", bgr, self._coder)
            decoded = cast(Picture, cv2.imdecode(coded, cv2.IMREAD_COLOR))
            picture = cast(Picture, cv2.cvtColor(decoded, cv2.COLOR_BGR2RGB))
        return picture
