"""One robot's camera, from drawn pictures to observations: shutter, lens and sensor."""

import math
from dataclasses import dataclass

from mbot_protocol.drive.camera_model import CameraModel
from mbot_protocol.drive.picture import Picture
from mbot_workstation.learn.worlds.sensor import JPEG_SHARE, observation_processor
from mbot_workstation.sim.camera.frame_edges import FrameEdges
from mbot_workstation.sim.camera.rolling_shutter import RollingShutter
from mbot_workstation.sim.effects.effects import RealWorldEffects
from mbot_workstation.sim.effects.isp_settings import isp_settings
from mbot_workstation.sim.effects.perturbed_robot import observing_camera
from mbot_workstation.sim.simulation import SceneState


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
