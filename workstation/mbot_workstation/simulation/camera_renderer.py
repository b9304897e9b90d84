"""What the robot's camera sees in the simulation: the scene through its lens, blurred, noisy."""

from collections.abc import Sequence
from types import TracebackType
from typing import Self, cast

import cv2
import numpy as np

from mbot_protocol.picture import Picture
from mbot_workstation.simulation.colour_levels import levels
from mbot_workstation.simulation.lens_distortion import LensDistortion
from mbot_workstation.simulation.robot_mjcf import ROBOT_CAMERA
from mbot_workstation.simulation.scene_renderer import TRAINING, Quality, SceneRenderer
from mbot_workstation.simulation.sensor_noise import SensorNoise
from mbot_workstation.simulation.simulation import SceneState, Simulation


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
        noise_seed: int | None = None,
        gains: tuple[float, float, float] = (1.0, 1.0, 1.0),
    ) -> None:
        """Prepare to draw.

        Args:
            simulation: whose robot and scene; any other with the same parameters and room can be
                drawn too.
            width_px, height_px: the size; the whole view of the camera is in it at any size.
            quality: what a picture may cost.
            noise_seed: seed of the sensor's noise; None is a sensor without noise.
            gains: of red, green and blue: exposure and white balance.

        """
        self.width_px, self.height_px = width_px, height_px
        self._lens = LensDistortion(simulation.robot.camera, width_px, height_px)
        self._levels = None if gains == (1.0, 1.0, 1.0) else levels(gains)
        self._noise = None if noise_seed is None else SensorNoise(width_px, height_px, noise_seed)
        drawn = self._lens.drawn
        self._renderer = SceneRenderer(
            simulation, ROBOT_CAMERA, drawn.width_px, drawn.height_px, quality
        )

    def picture(self, states: SceneState | Sequence[SceneState]) -> Picture:
        """Take a picture.

        Args:
            states: one moment, or several over the exposure, which blur into one picture.

        Returns:
            Shape (height_px, width_px, 3), uint8, RGB.

        """
        moments = [states] if isinstance(states, SceneState) else states
        picture = self._lens.apply(_mean([self._renderer.draw(moment) for moment in moments]))
        if self._levels is not None:
            picture = cast(Picture, cv2.LUT(picture, self._levels))
        return picture if self._noise is None else self._noise.apply(picture)

    def close(self) -> None:
        """Give the OpenGL resources back."""
        self._renderer.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()


def _mean(pictures: Sequence[Picture]) -> Picture:
    if len(pictures) == 1:
        return pictures[0]
    total = np.zeros(pictures[0].shape, np.float32)
    for picture in pictures:
        cv2.accumulate(picture, total)
    return cast(Picture, cv2.convertScaleAbs(total, alpha=1 / len(pictures)))
