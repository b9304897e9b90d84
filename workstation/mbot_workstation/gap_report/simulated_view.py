"""What the simulated robot's camera sees from a place: with its calibration, and without."""

from dataclasses import dataclass, replace
from types import TracebackType
from typing import Self

import numpy as np

from mbot_protocol.picture import Picture
from mbot_workstation.calibration_files.calibration_folder import CalibrationFiles
from mbot_workstation.simulation.camera_renderer import CameraRenderer
from mbot_workstation.simulation.isp import IspSettings
from mbot_workstation.simulation.pose import Pose
from mbot_workstation.simulation.scene_parameters import SceneParameters
from mbot_workstation.simulation.scene_renderer import SHOW, Quality
from mbot_workstation.simulation.simulation import Simulation
from mbot_workstation.variation.isp_settings import isp_settings

NOWHERE = Pose(500.0, 0.0)
"""For a cube that is not there: a speck beyond the horizon."""

FREE_FLOOR_M = 100.0
"""For walls that are not there."""


@dataclass(frozen=True, slots=True)
class Place:
    """Where robot and object are, in the arena: its origin is where the panorama was taken, and x
    points to the panorama's middle.
    """

    robot: Pose
    cube: Pose | None = None


class SimulatedView:
    """Draws pictures; a context manager, which holds an OpenGL context."""

    def __init__(
        self,
        files: CalibrationFiles,
        room_picture: Picture,
        size: tuple[int, int],
        *,
        walls: bool,
        quality: Quality = SHOW,
    ) -> None:
        """Prepare to draw.

        Args:
            files: the robot; an empty one is nominal.
            room_picture: the panorama.
            size: width and height of the pictures.
            walls: whether the arena has any.
            quality: of the drawing.

        """
        scene = files.scene if walls else without_walls(files.scene)
        self._simulation = Simulation(files.robot, scene, room_picture)
        self._renderer = CameraRenderer(
            self._simulation,
            *size,
            quality,
            isp=IspSettings(gains=isp_settings(files.effects).gains),
        )

    def picture(self, place: Place) -> Picture:
        """Shape (height, width, 3), RGB."""
        self._simulation.place_object(place.cube or NOWHERE)
        self._simulation.place_robot(place.robot)
        self._simulation.step(0.2)  # the soft contacts take the weight
        return self._renderer.picture(self._simulation.snapshot())

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._renderer.close()


def without_walls(scene: SceneParameters) -> SceneParameters:
    """The scene with its walls out of sight."""
    return replace(scene, arena=replace(scene.arena, wall_m=FREE_FLOOR_M, border_m=FREE_FLOOR_M))


def mean_difference(first: Picture, second: Picture) -> float:
    """Mean absolute difference of all levels, of 255."""
    return float(np.abs(first.astype(np.int16) - second.astype(np.int16)).mean())
