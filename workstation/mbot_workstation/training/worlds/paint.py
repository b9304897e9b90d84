"""Colours of a simulation that differ from robot to robot, light to light."""

from mbot_workstation.simulation.engine import MjModel
from mbot_workstation.simulation.scene_mjcf import CUBE

FLOOR = "vinyl"


class Paint:
    """The cube's and the floor's brightness in one model; the walls go with the floor."""

    def __init__(self, model: MjModel) -> None:
        self._model = model
        self._cube: int = model.material(CUBE).id
        self._floor: int = model.material(FLOOR).id
        self._walls = [i for i in range(model.ngeom) if model.geom(i).name.startswith("wall ")]
        self._materials = model.mat_rgba.copy()
        self._geoms = model.geom_rgba.copy()

    def apply(self, cube_brightness: float, floor_brightness: float) -> None:
        """Scale the colours the model was compiled with."""
        colours, shapes = self._model.mat_rgba, self._model.geom_rgba
        colours[self._cube, :3] = self._materials[self._cube, :3] * cube_brightness
        colours[self._floor, :3] = self._materials[self._floor, :3] * floor_brightness
        shapes[self._walls, :3] = self._geoms[self._walls, :3] * floor_brightness
