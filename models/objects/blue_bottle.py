"""Makes blue-bottle.glb: a bottle turned about its axis, in one colour."""

from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from trimesh.visual.material import PBRMaterial

PROFILE_MM = [(0, 0), (34, 0), (36, 4), (36, 130), (30, 150), (15, 172), (15, 200), (0, 200)]
"""Radius and height."""

COLOUR_SRGB = [25, 60, 190]


def colour_linear(tree: dict[str, Any]) -> None:
    """As glTF wants it; trimesh by itself would round it to 1/255."""
    linear = [((share / 255 + 0.055) / 1.055) ** 2.4 for share in COLOUR_SRGB]
    tree["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = [*linear, 1.0]


bottle = trimesh.creation.revolve(np.array(PROFILE_MM) / 1000, sections=24)
bottle.vertices = bottle.vertices[:, (1, 2, 0)]  # glTF's y is up
material = PBRMaterial(baseColorFactor=[*COLOUR_SRGB, 255])
bottle.visual = trimesh.visual.TextureVisuals(material=material)
bottle.export(Path(__file__).with_name("blue-bottle.glb"), tree_postprocessor=colour_linear)
