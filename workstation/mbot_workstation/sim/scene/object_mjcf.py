"""Objects to fetch and things that are none, as part of a MuJoCo model."""

from typing import Any

import cv2
import numpy as np

from mbot_protocol.drive.picture import Picture
from mbot_workstation.sim.body.robot_mjcf import HIDDEN_GROUP
from mbot_workstation.sim.engine import MjSpec, mujoco
from mbot_workstation.sim.scene.finishes import FINISHES, finish
from mbot_workstation.sim.scene.material_mjcf import add_material
from mbot_workstation.sim.scene.target_object import MeshPart, Shape, TargetObject

DISTRACTORS = tuple(f"distractor {number}" for number in range(96))
"""Pieces of things that a look can put into the scene; nothing is there unless one does."""

BELOW_M = -10.0
"""Where objects wait that are not there."""

_SHAPES = {
    Shape.CUBE: mujoco.mjtGeom.mjGEOM_BOX,
    Shape.BALL: mujoco.mjtGeom.mjGEOM_SPHERE,
    Shape.CYLINDER: mujoco.mjtGeom.mjGEOM_CYLINDER,
    Shape.MESH: mujoco.mjtGeom.mjGEOM_MESH,
}


def object_name(kind: int = 0) -> str:
    """The name of an object's body and shape."""
    return f"object {kind}"


def shadow_name(kind: int = 0) -> str:
    """The name of an object's shadow, likewise."""
    return f"object {kind} shadow"


def mirrored_name(kind: int = 0) -> str:
    """The name of its image in the floor."""
    return f"object {kind} mirrored"


def label_names(kind: int = 0) -> tuple[str, str]:
    """The names of what is stuck on its sides."""
    return f"object {kind} label ahead", f"object {kind} label across"


def finish_material(finish: int) -> str:
    """The name of the material of a distractor with this finish."""
    return f"finish {finish}"


def geom_names(kind: int, thing: TargetObject) -> list[str]:
    """The names of what it consists of: one, or a mesh's parts."""
    further = 0 if thing.mesh is None else len(thing.mesh.parts) - 1
    return [object_name(kind), *(f"object {kind} part {number + 1}" for number in range(further))]


def object_material(geom: str, wear: int) -> str:
    """The name of the material of what it consists of, clean or worn."""
    return f"{geom} worn {wear}"


def add_object(spec: MjSpec, kind: int, thing: TargetObject) -> None:
    """Add an object and the shadow it casts where renderers draw none."""
    # All but the one to fetch are kept below the floor.
    place = [1, 0, 0 if kind == 0 else BELOW_M]
    body = spec.worldbody.add_body(name=object_name(kind), mocap=True, pos=place)
    half, half_height = thing.width_m / 2, thing.height_m / 2
    parts = [None] if thing.mesh is None else thing.mesh.parts
    for name, part in zip(geom_names(kind, thing), parts, strict=True):
        for wear in range(FINISHES):
            picture = thing.texture if part is None else part.picture
            _add_object_material(spec, object_material(name, wear), thing, picture, finish(wear))
        if part is not None:
            _add_mesh(spec, name, part)
        body.add_geom(
            name=name,
            type=_SHAPES[thing.shape],
            size=[half, half_height, 0] if thing.shape is Shape.CYLINDER else [half] * 3,
            pos=[0, 0, half_height if part is None else 0],
            meshname="" if part is None else name,
            material=object_material(name, 0),
            mass=0,
            contype=0,  # the task decides about touching; the object is taken away at once
            conaffinity=0,
        )
    for unseen in (mirrored_name(kind), *label_names(kind)):
        _add_unseen(body, unseen)
    # For renderers without shadows; a body of its own, since a shadow does not turn with its thing.
    shadow = spec.worldbody.add_body(name=shadow_name(kind), mocap=True, pos=place)
    _add_unseen(shadow, shadow_name(kind))


def _add_object_material(
    spec: MjSpec, name: str, thing: TargetObject, picture: Picture | None, wear: Picture
) -> None:
    if picture is None:
        add_material(spec, name, wear)
    else:
        rows, columns = picture.shape[:2]
        scuffs = cv2.resize(wear, (columns, rows), interpolation=cv2.INTER_NEAREST)
        worn = (picture * (scuffs / 255)).astype(np.uint8)
        add_material(spec, name, worn, on_sides=thing.mesh is None)
    spec.material(name).rgba = [*thing.rgb, 1]


def _add_mesh(spec: MjSpec, name: str, part: MeshPart) -> None:
    texture: dict[str, Any] = {}
    if part.corners_uv is not None:
        texture = {
            "usertexcoord": part.corners_uv.ravel(),
            "userfacetexcoord": np.arange(part.triangles.size),
        }
    spec.add_mesh(
        name=name,
        uservert=part.vertices_m.ravel(),
        userface=part.triangles.ravel(),
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,  # it need not be closed
        **texture,
    )


def add_distractors(spec: MjSpec) -> None:
    """Add what looks can show."""
    for index in range(FINISHES):
        add_material(spec, finish_material(index), finish(index))
    for name in DISTRACTORS:
        _add_unseen(spec.worldbody, name)


def _add_unseen(body: Any, name: str) -> None:
    """A shape that is seen once a `SceneLook` shows it, and touches nothing."""
    body.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[0.01, 0.01, 0.01],
        mass=0,
        group=HIDDEN_GROUP,
        contype=0,
        conaffinity=0,
        castshadow=False,
    )
