"""From light to numbers at the observation's size: what of a frame's processing is left there."""

import math

from mbot_protocol.policy.policy_contract import OBSERVATION_SIDE_PX
from mbot_workstation.sim.camera.isp import ImageSignalProcessor

FRAME_PX = 320 * 240
"""Of the camera's frames, which `Observer` averages: an observation's noise is that much less."""

NOISE_SHARE = math.sqrt(OBSERVATION_SIDE_PX**2 / FRAME_PX)
"""Checked: noise of strength 1, 3, 5 in frames leaves 0.55, 1.21, 1.94 grey levels RMS in
observations, and this 0.45, 1.23, 2.02."""

JPEG_SHARE = 0.25
"""A coder at quality q harms a frame's observation as one at 100 - 0.25 (100 - q) harms the
observation itself: quality 90, 80, 60 of frames leave 2.1, 2.8, 4.2 grey levels RMS in the cube's
redness, and 97, 95, 90 of observations 2.0, 2.8, 4.4 (measured)."""


def observation_processor(noise_seed: int) -> ImageSignalProcessor:
    """The camera's processing, to be done on observations instead of frames."""
    side = OBSERVATION_SIDE_PX
    return ImageSignalProcessor(side, side, noise_seed, NOISE_SHARE)
