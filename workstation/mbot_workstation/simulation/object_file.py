"""`--object FILE.toml`: the kinds of object to fetch, and the pictures and meshes that it names."""

import re
from io import BytesIO
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np
from msgspec import Meta, Struct

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.picture import Picture
from mbot_protocol.toml_file import read_toml
from mbot_workstation.simulation.target_object import RED_CUBE, Mesh, Shape, TargetObject

MOST_TRIANGLES = 20_000
"""More are not seen in 64 x 64 pixels, and are drawn for every one of them."""

TEXTURE_PX = 256
"""Larger ones are reduced to this side."""

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
        colour: "#rrggbb"; white if there is a texture.
        texture: a picture, for each side of what is not a mesh; beside the file.
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
    return tuple(_made(section, path) for section in read_toml(path, ObjectFile).object)


def _made(section: ObjectSection, path: Path) -> TargetObject:
    texture = None if section.texture is None else _texture(path.parent / section.texture)
    mesh, colour = None, section.colour or "#ffffff"
    if section.mesh is not None:
        height_m = (section.height_mm or 0) / 1000
        mesh, own_colour, own_texture = _mesh(path.parent / section.mesh, height_m)
        colour = section.colour or own_colour
        texture = own_texture if texture is None else texture
        if texture is not None and mesh.texture_uv is None:
            raise ConfigurationError(
                f"{path.parent / section.mesh} does not say where a texture goes (no UV), give "
                f"{section.name!r} a colour instead"
            )
    if mesh is not None:
        width_m, height_m = _extent_m(mesh)
        if not NARROWEST_MM <= 1000 * width_m <= WIDEST_MM:
            raise ConfigurationError(
                f"{section.name!r} is {1000 * width_m:.0f} mm wide at that height, expected "
                f"{NARROWEST_MM} to {WIDEST_MM} mm"
            )
    else:
        width_m = (section.width_mm or 0) / 1000
        height_m = width_m if section.height_mm is None else section.height_mm / 1000
    red, green, blue = bytes.fromhex(colour[1:])
    return TargetObject(
        section.name, section.shape, width_m, height_m, (red, green, blue), texture, mesh
    )


def _texture(path: Path) -> Picture:
    try:
        data = np.fromfile(path, np.uint8)
    except OSError as error:
        raise ConfigurationError(f"can't read the texture {path}: {error.strerror}") from None
    picture = cv2.imdecode(data, cv2.IMREAD_COLOR) if data.size else None
    if picture is None:
        raise ConfigurationError(f"{path} is not a PNG or JPEG")
    return _square(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB).astype(np.uint8))


def _square(picture: Picture) -> Picture:
    side = min(TEXTURE_PX, *picture.shape[:2])
    return cv2.resize(picture, (side, side), interpolation=cv2.INTER_AREA).astype(np.uint8)


def _mesh(path: Path, height_m: float) -> tuple[Mesh, str, Picture | None]:
    """A GLB file's surface at this height, its base colour, and its picture if it has one."""
    import trimesh  # slow to import, and hardly ever needed

    try:
        content = path.read_bytes()
    except OSError as error:
        raise ConfigurationError(f"can't read the mesh {path}: {error.strerror}") from None
    try:
        scene: Any = trimesh.load_scene(BytesIO(content), file_type="glb")
        surface: Any = scene.to_mesh()
        vertices = np.asarray(surface.vertices, np.float64)[:, (2, 0, 1)]  # glTF's y is up
        triangles = np.asarray(surface.faces, np.int32)
    except Exception as error:  # its parser raises whatever a broken file leads to
        raise ConfigurationError(f"{path} is not a GLB file that can be read: {error}") from None
    if not 4 <= len(triangles) <= MOST_TRIANGLES:
        raise ConfigurationError(
            f"{path} has {len(triangles):,} triangles, expected 4 to {MOST_TRIANGLES:,}; reduce "
            "it, in Blender by the modifier Decimate"
        )
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    if not np.isfinite(vertices).all() or min(high - low) <= 0:
        raise ConfigurationError(f"{path} is flat or not finite, expected something that stands")
    middle = np.array([*(low + high)[:2] / 2, low[2]])
    material = getattr(surface.visual, "material", None)
    uv = getattr(surface.visual, "uv", None)
    mesh = Mesh(
        (vertices - middle) * (height_m / (high - low)[2]),
        triangles,
        None if uv is None else np.asarray(uv, np.float64),
    )
    return mesh, _base_colour(material), _base_picture(material)


def _base_colour(material: Any) -> str:
    factor = getattr(material, "baseColorFactor", None)
    red, green, blue = (255, 255, 255) if factor is None else [int(part) for part in factor[:3]]
    return f"#{red:02x}{green:02x}{blue:02x}"


def _base_picture(material: Any) -> Picture | None:
    picture = getattr(material, "baseColorTexture", None)
    return None if picture is None else _square(np.asarray(picture.convert("RGB"), np.uint8))


def _extent_m(mesh: Mesh) -> tuple[float, float]:
    """The wider side of its footprint, and its height."""
    ahead, across, height = np.ptp(mesh.vertices_m, axis=0).tolist()
    return max(ahead, across), height
