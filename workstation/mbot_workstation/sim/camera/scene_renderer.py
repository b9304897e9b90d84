"""Draws a simulated scene from one of its cameras, off-screen, with MuJoCo's OpenGL renderer."""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from mbot_protocol.drive.picture import Picture
from mbot_workstation.sim.engine import (
    MjData,
    MjModel,
    mujoco,
    open_gl_context,
    open_renderer,
)
from mbot_workstation.sim.simulation import SceneState, Simulation

MOST_GEOMS = 256
"""A scene has 150, eight meshes of the most parts 80 more; MuJoCo's usual 10,000 only cost memory.
"""


@dataclass(frozen=True, slots=True)
class Quality:
    """What a picture may cost.

    Attributes:
        shadow_map_px: side of the shadow map; 0 draws no shadows.
        samples: samples per pixel against jagged edges; 0 is one.
        reflections: whether the floor mirrors a little.
        facets: of round things, around and from pole to pole.

    """

    shadow_map_px: int
    samples: int
    reflections: bool
    facets: tuple[int, int] = (28, 16)


TRAINING = Quality(shadow_map_px=0, samples=0, reflections=False)
"""Thousands of small pictures a second."""

SHOW = Quality(shadow_map_px=512, samples=4, reflections=True)
"""A believable picture: soft shadow, minor reflection, as in the paper's simulation."""


class SceneRenderer:
    """One camera at one size. Holds an OpenGL context: close it, or use it in a `with`.

    Use it only in the thread that made it. It has its own copy of what there is to see, so the
    simulation may go on in another thread meanwhile.
    """

    def __init__(
        self,
        simulation: Simulation,
        camera: str,
        width_px: int,
        height_px: int,
        quality: Quality,
        gl: Any = None,
    ) -> None:
        """Prepare to draw.

        Args:
            simulation: the scene; its textures are loaded now.
            camera: name of the camera to draw from.
            width_px, height_px: size of the pictures.
            quality: what a picture may cost.
            gl: an OpenGL context to share, which whoever opened it makes current and frees; None
                opens an own one.

        """
        model: MjModel = simulation.model
        self._model = model
        self._data: MjData = mujoco.MjData(model)
        self._rows_up = np.empty((height_px, width_px, 3), np.uint8)
        self._viewport = mujoco.MjrRect(0, 0, width_px, height_px)
        self._owns_gl = gl is None
        self._gl = open_gl_context(width_px, height_px) if gl is None else gl
        self._gl.make_current()
        # A context takes its sizes from the model when it is made. A larger buffer than the
        # picture, or a shadow map nobody looks at, would cost time in every frame.
        model.vis.global_.offwidth, model.vis.global_.offheight = width_px, height_px
        model.vis.quality.offsamples = quality.samples
        model.vis.quality.shadowsize = quality.shadow_map_px
        # Light comes from afar and falls on all of a face alike: one rectangle does for sixteen (of
        # 4,000 pictures of any arena none differs in more than 6 pixels by more than 8 levels).
        model.vis.quality.numquads = 1
        model.vis.quality.numslices, model.vis.quality.numstacks = quality.facets
        self._context: Any = open_renderer(model)
        self._scene = mujoco.MjvScene(model, MOST_GEOMS)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = quality.shadow_map_px > 0
        self._scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = quality.reflections
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SKYBOX] = False
        self._scene.flags[mujoco.mjtRndFlag.mjRND_HAZE] = False
        self._options = mujoco.MjvOption()
        self._camera = mujoco.MjvCamera()
        self._camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
        self._camera.fixedcamid = model.camera(camera).id

    def draw(self, state: SceneState, model: MjModel | None = None) -> Picture:
        """Draw one moment.

        Args:
            state: the moment.
            model: of a simulation that differs from the renderer's own only in numbers (camera,
                sizes, colours), to be drawn with the renderer's textures; None is its own.

        Returns:
            Shape (height_px, width_px, 3), RGB.

        """
        if self._context is None:
            raise RuntimeError("the renderer is closed")
        model = self._model if model is None else model
        self._data.qpos[:] = state.joints
        self._data.mocap_pos[:] = state.moved_pos
        self._data.mocap_quat[:] = state.moved_quat
        mujoco.mj_kinematics(model, self._data)
        mujoco.mj_camlight(model, self._data)
        mujoco.mjv_updateScene(
            model,
            self._data,
            self._options,
            None,
            self._camera,
            mujoco.mjtCatBit.mjCAT_ALL.value,
            self._scene,
        )
        if self._owns_gl:
            self._gl.make_current()
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
        mujoco.mjr_render(self._viewport, self._scene, self._context)
        mujoco.mjr_readPixels(self._rows_up, None, self._viewport, self._context)
        return np.ascontiguousarray(self._rows_up[::-1])

    def close(self) -> None:
        """Give the OpenGL resources back; a second time does nothing."""
        if self._context is not None:
            self._gl.make_current()
            self._context.free()
            if self._owns_gl:
                self._gl.free()
            self._context = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
