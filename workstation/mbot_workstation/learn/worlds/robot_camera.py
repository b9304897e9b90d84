"""One robot's camera, from drawn pictures to observations: shutter, lens and sensor."""

import math
from dataclasses import dataclass

from mbot_protocol.drive.camera_model import CameraModel
from mbot_protocol.drive.picture import Picture
from mbot_protocol.policy.policy_contract import OBSERVATION_SIDE_PX
from mbot_workstation.sim.camera.frame_edges import FrameEdges
from mbot_workstation.sim.camera.isp import ImageSignalProcessor
from mbot_workstation.sim.camera.rolling_shutter import RollingShutter
from mbot_workstation.sim.effects.effects import RealWorldEffects
from mbot_workstation.sim.effects.isp_settings import isp_settings
from mbot_workstation.sim.effects.perturbed_robot import observing_camera
from mbot_workstation.sim.simulation import SceneState

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


@dataclass(frozen=True, slots=True)
class Glimpse:
    """A moment at which the camera looked.

    Attributes:
        state: what stood where.
        turn_rate_rad_s: of the robot, positive to the left.
        time_s: since the episode's start.

    """

    state: SceneState
    turn_rate_rad_s: float
    time_s: float


class RobotCamera:
    """The camera of a robot that changes with the effects."""

    def __init__(self, noise_seed: int, edges: FrameEdges) -> None:
        """Make the camera.

        Args:
            noise_seed: of its sensor.
            edges: of its frames, as it was calibrated.

        """
        self._edges = edges
        self._processor = observation_processor(noise_seed)
        self.become(RealWorldEffects(), pitch_down_deg=0.0)

    def become(self, effects: RealWorldEffects, pitch_down_deg: float) -> None:
        """Be the camera of the robot with these effects, mounted with this pitch."""
        self._shutter = RollingShutter(
            observing_camera(effects),
            exposure_s=effects.exposure_ms / 1000,
            readout_s=effects.readout_ms / 1000,
            pitch_down_rad=math.radians(pitch_down_deg),
        )
        self._processor.become(isp_settings(effects, JPEG_SHARE))

    def begin(self, drift_phase_rad: float) -> None:
        """Start an episode somewhere in the swing of the exposure."""
        self._processor.restart(drift_phase_rad)

    def view(self, glimpse: Glimpse) -> CameraModel:
        """The pinhole camera to draw the glimpse with."""
        return self._shutter.view(glimpse.turn_rate_rad_s)

    def picture(self, drawn: Picture, view: CameraModel, glimpse: Glimpse) -> Picture:
        """The observation, shape (64, 64, 3), from a picture of the glimpse drawn with the view."""
        light = self._shutter.expose(drawn, view, glimpse.turn_rate_rad_s)
        return self._processor.process(self._edges.apply(light), glimpse.time_s)
