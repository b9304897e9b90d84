"""Makes blue-bottle.glb: a bottle turned about its axis, in one colour."""

from pathlib import Path

import numpy as np
import trimesh
from trimesh.visual.material import PBRMaterial

PROFILE_MM = [(0, 0), (34, 0), (36, 4), (36, 130), (30, 150), (15, 172), (15, 200), (0, 200)]
"""Radius and height."""

bottle = trimesh.creation.revolve(np.array(PROFILE_MM) / 1000, sections=24)
bottle.vertices = bottle.vertices[:, (1, 2, 0)]  # glTF's y is up
bottle.visual = trimesh.visual.TextureVisuals(
    material=PBRMaterial(baseColorFactor=[25, 60, 190, 255])
)
bottle.export(Path(__file__).with_name("blue-bottle.glb"))
