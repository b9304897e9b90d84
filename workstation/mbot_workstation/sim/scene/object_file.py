"""`--object FILE.toml`: the kinds of object to fetch, and the pictures and meshes that it names."""

import re
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
from msgspec import Meta, Struct

from mbot_protocol.drive.picture import Picture
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.files.toml_file import read_toml
from mbot_workstation.pictures.picture_file import read_picture
from mbot_workstation.sim.engine import mujoco
from mbot_workstation.sim.scene.glb_file import TEXTURE_PX, read_glb
from mbot_workstation.sim.scene.mesh_parts import made_mesh
from mbot_workstation.sim.scene.object_mjcf import add_object
from mbot_workstation.sim.scene.target_object import RED_CUBE, Mesh, Shape, TargetObject

NARROWEST_MM, WIDEST_MM = 20, 300
"""A wider one, a fifth larger as training makes it, could touch a robot in front of which it
appears (`FetchRules.clearance_m`)."""

_Width = Annotated[float, Meta(ge=NARROWEST_MM, le=WIDEST_MM)]
_Height = Annotated[float, Meta(ge=20, le=400)]


class ObjectSection(Struct, frozen=True, forbid_unknown_fields=True):
    """One `[[object]]`.

    Attributes:
        name: for people.
        shape: cube, ball, cylinder or mesh.
        width_mm: a cube's edge, a ball's or cylinder's diameter; not of a mesh.
        height_mm: of a cylinder or a mesh, which is scaled to it.
        colour: "#rrggbb"; white if there is a texture. A mesh has it where it has no picture, in
            place of its own; pictures are multiplied by it.
        texture: a picture, for each side, or in place of a mesh's own; beside the file.
        mesh: a GLB file, likewise.

    """

    name: str
    shape: Shape
    width_mm: _Width | None = None
    height_mm: _Height | None = None
    colour: str | None = None
    texture: str | None = None
    mesh: str | None = None

    def __post_init__(self) -> None:
        if self.colour is not None and not re.fullmatch("#[0-9a-fA-F]{6}", self.colour):
            raise ValueError(f'colour is {self.colour!r}, expected such as "#28a03c"')
        wanted = {
            Shape.CUBE: {"width_mm"},
            Shape.BALL: {"width_mm"},
            Shape.CYLINDER: {"width_mm", "height_mm"},
            Shape.MESH: {"height_mm", "mesh"},
        }[self.shape]
        for key in ("width_mm", "height_mm", "mesh"):
            if (getattr(self, key) is not None) != (key in wanted):
                word = "is missing" if key in wanted else "has no meaning"
                raise ValueError(
                    f"{key} {word} for a {self.shape.value}, which takes "
                    f"{' and '.join(sorted(wanted))}"
                )
        if self.shape is not Shape.MESH and self.colour is None and self.texture is None:
            raise ValueError(f"colour or texture is missing for {self.name!r}")


class ObjectFile(Struct, frozen=True, forbid_unknown_fields=True):
    """The file."""

    object: Annotated[tuple[ObjectSection, ...], Meta(min_length=1, max_length=8)]


def read_objects(path: Path | str | None) -> tuple[TargetObject, ...]:
    """The kinds of object that a file tells of; the paper's red cube without a file.

    Raises:
        ConfigurationError: it, or a file that it names, can't be read or is unusable.

    """
    if path is None:
        return (RED_CUBE,)
    path = Path(path)
    return tuple(made_object(section, path) for section in read_toml(path, ObjectFile).object)


def made_object(section: ObjectSection, path: Path) -> TargetObject:
    """One section's; the file's path says where others lie. Raises as `read_objects`."""
    texture = None if section.texture is None else _texture(path.parent / section.texture)
    if section.mesh is not None:
        return _mesh_object(section, path.parent / section.mesh, texture)
    width_m = (section.width_mm or 0) / 1000
    height_m = width_m if section.height_mm is None else section.height_mm / 1000
    colour = _srgb(section.colour or "#ffffff")
    return TargetObject(section.name, section.shape, width_m, height_m, colour, texture)


def _mesh_object(section: ObjectSection, path: Path, texture: Picture | None) -> TargetObject:
    surfaces = read_glb(path)
    try:
        height_m, keeps = (section.height_mm or 0) / 1000, section.colour is None
        mesh, own_colour = made_mesh(surfaces, height_m, texture, keep_colours=keeps)
    except ConfigurationError as error:
        raise ConfigurationError(f"{path} {error}") from None
    colour = own_colour if section.colour is None else _srgb(section.colour)
    width_m, height_m = _extent_m(mesh)
    if not NARROWEST_MM <= 1000 * width_m <= WIDEST_MM:
        raise ConfigurationError(
            f"{section.name!r} is {1000 * width_m:.0f} mm wide at that height, expected "
            f"{NARROWEST_MM} to {WIDEST_MM} mm"
        )
    thing = TargetObject(section.name, section.shape, width_m, height_m, colour, mesh=mesh)
    alone = mujoco.MjSpec()
    add_object(alone, 0, thing)
    try:
        alone.compile()
    except ValueError as error:
        words = " ".join(str(error).split())
        raise ConfigurationError(f"{path} is nothing MuJoCo draws: {words}") from None
    return thing


def _srgb(colour: str) -> tuple[int, int, int]:
    red, green, blue = bytes.fromhex(colour[1:])
    return red, green, blue


def _texture(path: Path) -> Picture:
    picture = read_picture(path, turn=True)
    side = min(TEXTURE_PX, *picture.shape[:2])
    return cv2.resize(picture, (side, side), interpolation=cv2.INTER_AREA).astype(np.uint8)


def _extent_m(mesh: Mesh) -> tuple[float, float]:
    """The wider side of its footprint, and its height."""
    ahead, across, height = np.ptp(mesh.vertices_m, axis=0).tolist()
    return max(ahead, across), height
