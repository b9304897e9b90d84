"""What the robot's camera sees in the simulation: through its lens, shutter and processing."""

import math
from dataclasses import dataclass
from typing import Self

from mbot_protocol.drive.picture import Picture
from mbot_workstation.sim.body.robot_mjcf import ROBOT_CAMERA, aim_camera
from mbot_workstation.sim.camera.isp import ImageSignalProcessor, IspSettings
from mbot_workstation.sim.camera.lens_distortion import LensDistortion
from mbot_workstation.sim.camera.rolling_shutter import RollingShutter
from mbot_workstation.sim.camera.scene_renderer import TRAINING, Quality, SceneRenderer
from mbot_workstation.sim.simulation import SceneState, Simulation


@dataclass(frozen=True, slots=True)
class Shutter:
    """When a camera's rows collect light.

    Attributes:
        exposure_s: how long each row does; a turn blurs it.
        readout_s: from the first row to the last; a turn shears the picture.

    """

    exposure_s: float = 0.0
    readout_s: float = 0.0


class CameraRenderer:
    """Pictures of the robot's camera at one size.

    It holds an OpenGL context: close it, or use it in a `with`, in the thread that made it.

    Attributes:
        width_px, height_px: size of the pictures.

    """

    def __init__(
        self,
        simulation: Simulation,
        width_px: int,
        height_px: int,
        quality: Quality = TRAINING,
        *,
        shutter: Shutter | None = None,
        isp: IspSettings | None = None,
        noise_seed: int = 0,
    ) -> None:
        """Prepare to draw.

        Args:
            simulation: whose robot and scene; any other with the same parameters and room can be
                drawn too.
            width_px, height_px: the size; the whole view of the camera is in it at any size.
            quality: what a picture may cost.
            shutter: None freezes every motion.
            isp: the camera's processing; None leaves the light as it is.
            noise_seed: of the sensor's noise, if `isp` has any.

        """
        self.width_px, self.height_px = width_px, height_px
        robot = simulation.robot
        self._model = simulation.model
        self._lens = LensDistortion(robot.camera, width_px, height_px)
        self._shutter: RollingShutter | None = None
        drawn = self._lens.drawn
        if shutter is not None and shutter != Shutter():
            drawn = robot.camera.scaled_to(width_px, height_px)
            pitch_down_rad = math.radians(robot.camera_mount.pitch_down_deg)
            self._shutter = RollingShutter(
                drawn, shutter.exposure_s, shutter.readout_s, pitch_down_rad
            )
        self._isp = ImageSignalProcessor(width_px, height_px, noise_seed)
        self._isp.become(isp or IspSettings())
        self._renderer = SceneRenderer(
            simulation, ROBOT_CAMERA, drawn.width_px, drawn.height_px, quality
        )

    def picture(
        self, state: SceneState, turn_rate_rad_s: float = 0.0, time_s: float = 0.0
    ) -> Picture:
        """Take a picture.

        Args:
            state: the middle of exposure and read-out.
            turn_rate_rad_s: of the robot then, positive to the left; a shutter shows it.
            time_s: of the picture, on a clock that only goes on: automatics follow it.

        Returns:
            Shape (height_px, width_px, 3), uint8, RGB.

        """
        if self._shutter is None:
            light = self._lens.apply(self._renderer.draw(state))
        else:
            view = self._shutter.view(turn_rate_rad_s)
            aim_camera(self._model, view)
            light = self._shutter.expose(self._renderer.draw(state), view, turn_rate_rad_s)
        return self._isp.process(light, time_s)

    def close(self) -> None:
        """Give the OpenGL resources back."""
        self._renderer.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
