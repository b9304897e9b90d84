"""GLB files written byte by byte, so that each says exactly what it says."""

import json
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

RED, GREEN, BLUE = (255, 0, 0), (0, 255, 0), (0, 0, 255)


@dataclass(frozen=True, slots=True)
class Part:
    """A box 1 x 1 wide, y being up.

    Attributes:
        low, high: where it is.
        material: its number; None without.
        uv: whether it says where a picture goes.
        colour: of all corners.

    """

    low: float = 0.0
    high: float = 1.0
    material: int | None = None
    uv: bool = False
    colour: tuple[float, float, float, float] | None = None


def plain(*factor: float) -> dict[str, Any]:
    return {"pbrMetallicRoughness": {"baseColorFactor": [*factor], "metallicFactor": 0}}


def pictured(number: int, *factor: float) -> dict[str, Any]:
    rough: dict[str, Any] = {"baseColorTexture": {"index": number}}
    if factor:
        rough["baseColorFactor"] = [*factor]
    return {"pbrMetallicRoughness": rough}


def png(*rows: tuple[int, int, int]) -> bytes:
    """Four pixels wide, each row of one colour."""
    picture = np.repeat(np.array(rows, np.uint8)[:, None, ::-1], 4, axis=1)
    return cv2.imencode(".png", picture)[1].tobytes()


def _box(low: float, high: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    a, b = -0.5, 0.5
    sides = [
        [(a, low, b), (b, low, b), (b, high, b), (a, high, b)],
        [(b, low, a), (a, low, a), (a, high, a), (b, high, a)],
        [(b, low, b), (b, low, a), (b, high, a), (b, high, b)],
        [(a, low, a), (a, low, b), (a, high, b), (a, high, a)],
        [(a, high, b), (b, high, b), (b, high, a), (a, high, a)],
        [(a, low, a), (b, low, a), (b, low, b), (a, low, b)],
    ]
    triangles = [4 * side + corner for side in range(6) for corner in (0, 1, 2, 0, 2, 3)]
    uv = [(0, 1), (1, 1), (1, 0), (0, 0)] * 6
    return np.array(sides, "<f4").reshape(-1, 3), np.array(triangles, "<u2"), np.array(uv, "<f4")


def write_glb(
    path: Path,
    parts: Sequence[Part],
    materials: Sequence[dict[str, Any]] = (),
    images: Sequence[bytes] = (),
    more: dict[str, Any] | None = None,
) -> Path:
    """Write it, and `more` at the top of its header."""
    blob = bytearray()
    views: list[dict[str, Any]] = []
    accessors: list[dict[str, Any]] = []

    def view(data: bytes) -> int:
        blob.extend(bytes(-len(blob) % 4))
        views.append({"buffer": 0, "byteOffset": len(blob), "byteLength": len(data)})
        blob.extend(data)
        return len(views) - 1

    def accessor(values: np.ndarray, kind: str) -> int:
        of = {"<f4": 5126, "<u2": 5123}[values.dtype.str]
        told = {"bufferView": view(values.tobytes()), "componentType": of, "type": kind}
        accessors.append(told | {"count": len(values)})
        return len(accessors) - 1

    meshes: list[dict[str, Any]] = []
    for part in parts:
        places, triangles, uv = _box(part.low, part.high)
        attributes = {"POSITION": accessor(places, "VEC3")}
        if part.uv:
            attributes["TEXCOORD_0"] = accessor(uv, "VEC2")
        if part.colour is not None:
            attributes["COLOR_0"] = accessor(np.array([part.colour] * 24, "<f4"), "VEC4")
        primitive = {"attributes": attributes, "indices": accessor(triangles, "SCALAR")}
        if part.material is not None:
            primitive["material"] = part.material
        meshes.append({"primitives": [primitive]})
    tree: dict[str, Any] = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": list(range(len(meshes)))}],
        "nodes": [{"mesh": number} for number in range(len(meshes))],
        "meshes": meshes,
        "materials": list(materials),
        "images": [{"bufferView": view(image), "mimeType": "image/png"} for image in images],
        "textures": [{"source": number} for number in range(len(images))],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(blob)}],
    }
    path.write_bytes(packed(tree | (more or {}), bytes(blob)))
    return path


def packed(tree: dict[str, Any], blob: bytes) -> bytes:
    """A header and its numbers as a file."""
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    blob += bytes(-len(blob) % 4)
    head = struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(blob))
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    return head + chunks + struct.pack("<I4s", len(blob), b"BIN\0") + blob
