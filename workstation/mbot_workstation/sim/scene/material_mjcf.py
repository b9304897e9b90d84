"""Pictures on the surfaces of a MuJoCo model."""

import numpy as np

from mbot_protocol.drive.picture import Picture
from mbot_workstation.sim.engine import MjSpec, mujoco


def add_material(
    spec: MjSpec,
    name: str,
    picture: Picture,
    reflectance: float = 0.0,
    *,
    on_sides: bool = False,
) -> None:
    """A matte material with a picture on it, or on each of six sides."""
    _add_texture(spec, name, np.vstack([picture] * 6) if on_sides else picture, on_sides=on_sides)
    material = spec.add_material(name=name, specular=0, shininess=0, reflectance=reflectance)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name


def _add_texture(spec: MjSpec, name: str, picture: Picture, *, on_sides: bool) -> None:
    height, width, channels = picture.shape
    flat, sides = mujoco.mjtTexture.mjTEXTURE_2D, mujoco.mjtTexture.mjTEXTURE_CUBE
    texture = spec.add_texture(
        name=name,
        type=sides if on_sides else flat,
        width=width,
        height=height,
        nchannel=channels,
    )
    texture.data = np.ascontiguousarray(picture).tobytes()
