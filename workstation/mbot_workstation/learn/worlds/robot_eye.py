"""Draws what robots see: one OpenGL context, one loaded room after another, any robot in them."""

from collections.abc import Sequence
from typing import Any, Self

from mbot_protocol.drive.picture import Picture
from mbot_protocol.policy.policy_contract import OBSERVATION_SIDE_PX
from mbot_workstation.learn.worlds.world import World
from mbot_workstation.sim.body.robot_mjcf import ROBOT_CAMERA, aim_camera
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.camera.scene_renderer import Quality, SceneRenderer
from mbot_workstation.sim.engine import open_gl_context
from mbot_workstation.sim.scene.floor_textures import FloorTexture
from mbot_workstation.sim.scene.scene_parameters import SceneParameters
from mbot_workstation.sim.simulation import Simulation

OBSERVATION = Quality(shadow_map_px=0, samples=4, reflections=False, facets=(14, 7))
"""64 x 64 with 4 samples a pixel: what is 2 pixels wide must not come and go with the sampling.
Against an area-averaged picture of 640 x 640, the cube's redness errs by 3.2 grey levels RMS, with
one sample by 12.3 at 60 % of the cost, averaged from 128 x 128 by 5.2 at 110 % (measured). Homes
full of round things are drawn in 0.7 of the time with half as many facets as MuJoCo's."""


class RobotEye:
    """Observations in several rooms. Close it, or use it in a `with`, in one thread."""

    def __init__(
        self,
        rooms: Sequence[Picture],
        robot: RobotParameters | None = None,
        scene: SceneParameters | None = None,
        floors: Sequence[FloorTexture] = (),
    ) -> None:
        """Load the rooms.

        Args:
            rooms: panoramas, shape (h, 2 h, 3), RGB.
            robot: of the worlds, so that this one has the same parts; the nominal one when None.
            scene: of the worlds; likewise.
            floors: of the worlds, besides the nominal one.

        """
        side = OBSERVATION_SIDE_PX
        self._gl: Any = open_gl_context(side, side)
        self._rooms = [
            SceneRenderer(
                Simulation(robot, scene, room, floors),
                ROBOT_CAMERA,
                side,
                side,
                OBSERVATION,
                gl=self._gl,
            )
            for room in rooms
        ]

    def observe(self, world: World) -> Picture:
        """What the policy sees now. Shape (64, 64, 3), RGB."""
        return self.observe_all([world])[0]

    def observe_all(self, worlds: Sequence[World]) -> list[Picture]:
        """What it sees in each of these."""
        self._gl.make_current()  # 12 us: once for all of them
        return [self._observed(world) for world in worlds]

    def _observed(self, world: World) -> Picture:
        glimpse, camera = world.glimpse, world.camera
        view = camera.view(glimpse)
        aim_camera(world.simulation.model, view)
        drawn = self._rooms[world.room].draw(glimpse.state, world.simulation.model)
        return camera.picture(drawn, view, glimpse)

    def close(self) -> None:
        """Give the OpenGL resources back; a second time does nothing."""
        for room in self._rooms:
            room.close()
        if self._gl is not None:
            self._gl.free()
            self._gl = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
