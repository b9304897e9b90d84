"""GLB files: their surfaces and what is on each, as the format means it.

trimesh reads geometry and scene. Of what it would drop or round it is told nothing, or in other
words: coordinates of pictures and colours of corners are attributes of their own to it, materials
are numbers.
"""

import base64
import json
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mbot_protocol.drive.picture import Picture
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.files.git_lfs import refuse_pointer
from mbot_workstation.pictures.picture_file import decode_picture

MOST_TRIANGLES = 20_000
"""More are not seen in 64 x 64 pixels, and are drawn for every one of them."""

MOST_BYTES = 1 << 28
"""Of all the numbers a header speaks of. The most triangles take 4 MB; a mesh that is yet to be
reduced should be told so."""

MOST_PARTS = MOST_TRIANGLES
"""Nodes, meshes, their primitives, accessors and all else that a header lists, used or not: where
each triangle is a mesh of its own, a thing isn't seen either."""

TEXTURE_PX = 256
"""Larger pictures are reduced to this side."""

MOST_PICTURES = 8
"""A shape each, of which a renderer draws so many (`scene_renderer.MOST_GEOMS`)."""

_UV, _COLOURS = "_UV", "_COLOURS"
_GLOSSY = "KHR_materials_pbrSpecularGlossiness"
_MAY_BE_REQUIRED = {"KHR_materials_unlit", _GLOSSY, "EXT_texture_webp"}
_SIZES = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
_COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_TRIANGLES, _STRIP, _FAN = 4, 5, 6


@dataclass(frozen=True, slots=True)
class GlbMaterial:
    """What a surface is made of.

    Attributes:
        factor: what its colours are multiplied with; linear, shape (3,).
        picture: on it, at most `TEXTURE_PX` wide and high, if there is one.

    """

    factor: NDArray[np.float64]
    picture: Picture | None = None


@dataclass(frozen=True, slots=True)
class GlbSurface:
    """One primitive, where the scene has it.

    Attributes:
        vertices: shape (n, 3), in the file's unit, its y being up.
        triangles: indices of vertices, shape (m, 3).
        material: what it is made of.
        uv: of each vertex, the picture's upper left corner being the origin; shape (n, 2).
        colours: of each vertex, by which the material's are multiplied; linear, shape (n, 3).

    """

    vertices: NDArray[np.float64]
    triangles: NDArray[np.int32]
    material: GlbMaterial
    uv: NDArray[np.float64] | None
    colours: NDArray[np.float64] | None


def read_glb(path: Path) -> list[GlbSurface]:
    """Its surfaces; points and lines are none.

    Raises:
        ConfigurationError: it can't be read, needs what is not read here, or is too large.

    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise ConfigurationError(f"can't read the mesh {path}: {error.strerror}") from None
    refuse_pointer(path, content)
    try:
        return _read(content)
    except ConfigurationError as error:
        raise ConfigurationError(f"{path} {error}") from None
    except Exception as error:  # what a broken file leads to, here and in trimesh, may be anything
        words = " ".join(str(error).split()) or type(error).__name__
        raise ConfigurationError(f"{path} is not a GLB file that can be read: {words}") from None


def _read(content: bytes) -> list[GlbSurface]:
    magic, _, _, length, kind = struct.unpack_from("<4sIII4s", content)
    if magic != b"glTF" or kind != b"JSON":
        raise ValueError("it does not begin as one")
    header, rest = json.loads(content[20 : 20 + length]), content[20 + length :]
    _refuse_unread(header)
    _refuse_large(header)
    materials = _materials(header, rest[8:])
    _reword(header)
    text = json.dumps(header).encode()
    head = struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text) + len(rest), len(text), b"JSON")
    surfaces = list(_surfaces(head + text + rest, materials))
    if not surfaces:
        raise ConfigurationError("shows no surface: its scene has no mesh in it")
    return surfaces


def _refuse_unread(header: dict[str, Any]) -> None:
    for name in header.get("extensionsRequired", []):
        if "compression" in name:
            raise ConfigurationError(f"is compressed by {name}: export without compression")
        if name not in _MAY_BE_REQUIRED:
            raise ConfigurationError(f"needs {name}, which is not read here: export without it")
    for primitive in _primitives(header):
        if primitive.get("mode") == _FAN:
            raise ConfigurationError("has fans of triangles: export plain triangles")
        for index in _accessors(primitive):
            if "sparse" in header["accessors"][index]:
                raise ConfigurationError("has sparse accessors: export without them")


def _refuse_large(header: dict[str, Any]) -> None:
    """Before trimesh makes room for it, for each use anew."""
    parts = sum(len(listed) for listed in header.values() if isinstance(listed, list))
    parts += sum(len(mesh["primitives"]) for mesh in header.get("meshes", []))
    parts += sum(len(node.get("children", [])) for node in header.get("nodes", []))
    if parts > MOST_PARTS:
        raise ConfigurationError(
            f"lists {parts:,} nodes, meshes and other parts, expected at most {MOST_PARTS:,}; "
            "export the object alone, joined into one mesh and without animations"
        )
    sizes = [
        one["count"] * _SIZES[one["componentType"]] * _COMPONENTS[one["type"]]
        for one in header.get("accessors", [])
    ]
    used = sum(sizes[index] for primitive in _primitives(header) for index in _accessors(primitive))
    views = sum(view["byteLength"] for view in header.get("bufferViews", []))
    whole = used + views + sum(sizes)
    if min(sizes, default=0) < 0 or not 0 <= whole <= MOST_BYTES:
        raise ConfigurationError(
            f"speaks of {whole / 1e6:,.0f} MB of numbers, expected at most {MOST_BYTES / 1e6:.0f}; "
            "reduce it, in Blender by the modifier Decimate"
        )
    of_meshes = [
        sum(_triangles(header, primitive) for primitive in mesh["primitives"])
        for mesh in header.get("meshes", [])
    ]
    triangles = sum(of_meshes[node["mesh"]] for node in header.get("nodes", []) if "mesh" in node)
    if not 4 <= triangles <= MOST_TRIANGLES:
        raise ConfigurationError(
            f"has {triangles:,} triangles, expected 4 to {MOST_TRIANGLES:,}; reduce it, in Blender "
            "by the modifier Decimate"
        )


def _triangles(header: dict[str, Any], primitive: dict[str, Any]) -> int:
    corners = primitive.get("indices", primitive["attributes"]["POSITION"])
    count = int(header["accessors"][corners]["count"])
    return {_TRIANGLES: count // 3, _STRIP: count - 2}.get(primitive.get("mode", _TRIANGLES), 0)


def _primitives(header: dict[str, Any]) -> Iterator[dict[str, Any]]:
    for mesh in header.get("meshes", []):
        yield from mesh["primitives"]


def _accessors(primitive: dict[str, Any]) -> list[int]:
    indices = [primitive["indices"]] if "indices" in primitive else []
    return [*primitive["attributes"].values(), *indices]


def _reword(header: dict[str, Any]) -> None:
    """Materials by their numbers, without pictures; what is on corners under other names."""
    told = header.get("materials", [])
    for primitive in _primitives(header):
        index, attributes = primitive.get("material"), primitive["attributes"]
        kept = {"POSITION": attributes["POSITION"]}
        picture = {} if index is None else _base(told[index])[1]
        uv = f"TEXCOORD_{picture.get('texCoord', 0)}"
        for name, own in ((uv, _UV), ("COLOR_0", _COLOURS)):
            if name in attributes:
                kept[own] = attributes[name]
        primitive["attributes"], primitive["material"] = kept, 0 if index is None else index + 1
        primitive.pop("extensions", None)
    header["materials"] = [{"name": str(number)} for number in range(len(told) + 1)]
    for key in ("images", "textures"):
        header.pop(key, None)


def _base(material: dict[str, Any]) -> tuple[list[float], dict[str, Any]]:
    """A material's factor, and what it says of its picture."""
    glossy = material.get("extensions", {}).get(_GLOSSY)
    if glossy is not None:
        return glossy.get("diffuseFactor", [1, 1, 1]), glossy.get("diffuseTexture", {})
    rough = material.get("pbrMetallicRoughness", {})
    return rough.get("baseColorFactor", [1, 1, 1]), rough.get("baseColorTexture", {})


def _materials(header: dict[str, Any], binary: bytes) -> dict[int, GlbMaterial]:
    """Those in use, by their numbers in `_reword`; 0 is what has none."""
    told = header.get("materials", [])
    used = {p["material"] for p in _primitives(header) if "material" in p}
    pictured = sum(bool(_base(told[index])[1]) for index in used)
    if pictured > MOST_PICTURES:
        raise ConfigurationError(
            f"has {pictured} materials with a picture, expected at most {MOST_PICTURES}: bake them "
            "into one"
        )
    materials = {0: GlbMaterial(np.ones(3))}
    for index in used:
        factor, where = _base(told[index])
        if "KHR_texture_transform" in where.get("extensions", {}):
            raise ConfigurationError(
                "moves its picture by KHR_texture_transform, which is not read here: put that into "
                "its UV, and export again"
            )
        picture = _picture(header, binary, header["textures"][where["index"]]) if where else None
        materials[index + 1] = GlbMaterial(np.array(factor[:3], np.float64), picture)
    return materials


def _picture(header: dict[str, Any], binary: bytes, texture: dict[str, Any]) -> Picture:
    source = texture.get("extensions", {}).get("EXT_texture_webp", texture).get("source")
    if source is None:
        raise ConfigurationError("has a picture of a kind that is not read here: use PNG or JPEG")
    image = header["images"][source]
    if "bufferView" in image:
        view = header["bufferViews"][image["bufferView"]]
        start = view.get("byteOffset", 0)
        encoded = binary[start : start + view["byteLength"]]
    elif image["uri"].startswith("data:"):
        encoded = base64.b64decode(image["uri"].partition(",")[2])
    else:
        raise ConfigurationError(
            f"keeps its picture in another file ({image['uri']}): export it with everything inside"
        )
    try:
        picture = decode_picture(encoded)
    except ConfigurationError as error:
        raise ConfigurationError(f"holds a picture that can't be taken: {error}") from None
    if picture is None:
        raise ConfigurationError("holds a picture that can't be decoded: use PNG or JPEG")
    height, width = (min(TEXTURE_PX, side) for side in picture.shape[:2])
    return cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA).astype(np.uint8)


def _surfaces(content: bytes, materials: dict[int, GlbMaterial]) -> Iterator[GlbSurface]:
    import trimesh  # slow to import, and hardly ever needed

    scene: Any = trimesh.load_scene(BytesIO(content), file_type="glb")
    for node in scene.graph.nodes_geometry:
        place, name = scene.graph[node]
        mesh: Any = scene.geometry[name]
        if not isinstance(mesh, trimesh.Trimesh):
            continue
        mesh = mesh.copy()
        mesh.apply_transform(place)
        uv, colours = (mesh.vertex_attributes.get(key) for key in (_UV, _COLOURS))
        surface = GlbSurface(
            np.asarray(mesh.vertices, np.float64),
            np.asarray(mesh.faces, np.int32),
            materials[int(mesh.visual.material.name)],
            None if uv is None else _shares(uv),
            None if colours is None else _shares(colours)[:, :3],
        )
        for of_vertices in (surface.vertices, surface.uv, surface.colours):
            if of_vertices is not None and not 0 <= surface.triangles.max() < len(of_vertices):
                raise ValueError("its triangles have corners that are not there")
        yield surface


def _shares(values: NDArray[Any]) -> NDArray[np.float64]:
    """Whole numbers stand for shares of their largest."""
    whole = values.dtype.kind in "iu"
    return values / np.iinfo(values.dtype).max if whole else values.astype(np.float64)
