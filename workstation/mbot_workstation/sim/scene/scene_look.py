"""How an arena looks: everything about it that a compiled model can take on as numbers.

Physics never sees it. What a renderer has loaded (textures) is chosen by index.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mbot_workstation.sim.body.robot_mjcf import HIDDEN_GROUP
from mbot_workstation.sim.engine import MjModel, mujoco
from mbot_workstation.sim.scene.finishes import FINISHES
from mbot_workstation.sim.scene.object_mjcf import (
    DISTRACTORS,
    finish_material,
    geom_names,
    label_names,
    mirrored_name,
    object_material,
    shadow_name,
)
from mbot_workstation.sim.scene.scene_mjcf import MIRRORED_ROOM, ROOM, floor_material
from mbot_workstation.sim.scene.scene_parameters import SceneParameters
from mbot_workstation.sim.scene.target_object import RED_CUBE, Rgb, TargetObject

_SHOWN_GROUP = 0

_SHAPES = {
    "box": mujoco.mjtGeom.mjGEOM_BOX,
    "ball": mujoco.mjtGeom.mjGEOM_SPHERE,
    "post": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "egg": mujoco.mjtGeom.mjGEOM_ELLIPSOID,
}

_LABEL_RGBA = (0.93, 0.93, 0.9, 1.0)
_LABEL_SHARES = (1.006, 0.55, 0.42)
"""Of an object's half sizes: how far a label's plate stands out on two sides, how wide it is, how
high."""


@dataclass(frozen=True, slots=True)
class Distractor:
    """Something that is not the object, or a piece of it.

    Attributes:
        shape: "box", "ball", "egg" or "post".
        half_size_m: of a box or an egg along x, y, z; of a ball its radius first; of a post radius,
            radius, half its height.
        centre_m: in the arena's frame.
        yaw_rad: about the vertical.
        rgb: its colour.
        tilt_rad: about its own y, before the yaw.
        opacity: below 1 what is behind shines through.
        finish: index of what its surface is like; 0 is clean.

    """

    shape: str
    half_size_m: tuple[float, float, float]
    centre_m: tuple[float, float, float]
    yaw_rad: float
    rgb: Rgb
    tilt_rad: float = 0.0
    opacity: float = 1.0
    finish: int = 0

    @property
    def mirrored(self) -> "Distractor":
        """Its image in the floor."""
        x, y, z = self.centre_m
        return replace(self, centre_m=(x, y, -z), tilt_rad=-self.tilt_rad)


@dataclass(frozen=True, slots=True)
class Standing:
    """A thing on the floor that a robot can run into.

    Attributes:
        name: what it is.
        x_m, y_m: where its middle is, in the arena's frame.
        radius_m: of a circle about it.
        height_m: of its top.
        is_alike: whether it has the object's colour, so that from afar it may be the object.

    """

    name: str
    x_m: float
    y_m: float
    radius_m: float
    height_m: float
    is_alike: bool = False


@dataclass(frozen=True, slots=True)
class ObjectLook:
    """How one kind of object looks.

    Attributes:
        rgb: its colour.
        scale: its size over the nominal one; a mesh's stays 1.
        wear: index of its finish; 0 is clean.
        labelled: whether something white is stuck on its sides; not of a mesh.

    """

    rgb: Rgb = RED_CUBE.rgb
    scale: float = 1.0
    wear: int = 0
    labelled: bool = False


@dataclass(frozen=True, slots=True)
class SceneLook:
    """One look. The defaults are the nominal scene's.

    Attributes:
        floor: index of the floor's texture.
        floor_tint: what its colours are multiplied with.
        floor_gloss: strength of the light's reflex on it, in [0, 1].
        floor_mirrors: share of what the floor shows that it mirrors, in [0, 1).
        wall_height_m: 0 leaves the walls away.
        wall_rgb: their colour.
        foot_height_m: of a strip along the walls' feet; 0 for none.
        foot_rgb: its colour.
        objects: of each kind.
        light_direction: x, y, z it shines in.
        light_rgb, ambient_rgb: directional light, and light from everywhere.
        shadow: how dark the object's shadow is, in [0, 1]; for renderers that draw none.
        room_rgb: what the room's picture is multiplied with.
        distractors: other things to see.
        standing: what of them is in a robot's way.

    """

    floor: int = 0
    floor_tint: Rgb = (1.0, 1.0, 1.0)
    floor_gloss: float = 0.0
    floor_mirrors: float = 0.0
    wall_height_m: float = 0.20
    wall_rgb: Rgb = (0.85, 0.85, 0.84)
    foot_height_m: float = 0.0
    foot_rgb: Rgb = (0.0, 0.0, 0.0)
    objects: tuple[ObjectLook, ...] = (ObjectLook(),)
    light_direction: tuple[float, float, float] = (-0.5, 0.35, -0.8)
    light_rgb: Rgb = (0.3, 0.3, 0.3)
    ambient_rgb: Rgb = (0.7, 0.7, 0.7)
    shadow: float = 0.0
    room_rgb: Rgb = (1.0, 1.0, 1.0)
    distractors: tuple[Distractor, ...] = ()
    standing: tuple[Standing, ...] = ()

    def furnished(self, pieces: tuple[Distractor, ...]) -> "SceneLook":
        """With these as well, before all others: if there are too many, those are left out."""
        return replace(self, distractors=(*pieces, *self.distractors)) if pieces else self

    def shadow_of(self, height_m: float) -> tuple[float, float]:
        """How far what is so high shades the floor, in m, and towards which heading, in radians."""
        x, y, z = self.light_direction
        reach_m = min(height_m * math.hypot(x, y) / max(-z, 0.2), 2 * height_m)
        return reach_m, math.atan2(y, x)


def nominal_look(scene: SceneParameters) -> SceneLook:
    """A scene as its parameters say."""
    direct, ambient = 1 - scene.light.ambient, scene.light.ambient
    return SceneLook(
        wall_height_m=scene.arena.wall_height_m,
        wall_rgb=scene.arena.wall_rgb,
        objects=tuple(ObjectLook(thing.rgb) for thing in scene.objects),
        light_direction=scene.light.direction,
        light_rgb=(direct, direct, direct),
        ambient_rgb=(ambient, ambient, ambient),
    )


class SceneDresser:
    """Puts looks on one compiled model."""

    def __init__(
        self, model: MjModel, floors: int, objects: Sequence[TargetObject] = (RED_CUBE,)
    ) -> None:
        """Find the parts.

        Args:
            model: of `build_model`.
            floors: how many floors it can choose from, the nominal one included.
            objects: the kinds of object that it was built with.

        """
        self._model = model
        self._floors = [model.material(floor_material(i)).id for i in range(floors)]
        names = {model.geom(i).name: i for i in range(model.ngeom)}
        self._floor = names["floor"]
        self._objects = [_ObjectPart(model, *thing) for thing in enumerate(objects)]
        self._walls = [i for name, i in names.items() if name.startswith("wall ")]
        self._feet = [i for name, i in names.items() if name.startswith("foot ")]
        self._distractors = [names[name] for name in DISTRACTORS]
        # MuJoCo leaves out the pose of a shape that was compiled in its body's own, also later.
        extras = [extra for part in self._objects for extra in part.extras]
        for moved in (*self._distractors, *extras):
            model.geom_sameframe[moved] = mujoco.mjtSameFrame.mjSAMEFRAME_NONE
        self._finishes = [model.material(finish_material(i)).id for i in range(FINISHES)]
        self._room: int = model.material(ROOM).id
        self._mirrored_room = names[MIRRORED_ROOM]
        self._light: int = model.light("window").id

    def wear(
        self, look: SceneLook, object_brightness: float = 1.0, floor_brightness: float = 1.0
    ) -> None:
        """Look like this; the brightnesses scale the colours of object, and of floor and walls."""
        self._dress_floor(look, floor_brightness)
        self._dress_walls(look, floor_brightness)
        for part, worn in zip(self._objects, look.objects, strict=True):
            self._dress_object(part, worn, object_brightness)
            self._cast_shadow(part, look, worn.scale)
            self._mirror(part, look, worn, object_brightness)
        self._light_up(look)
        pieces = look.distractors
        if look.floor_mirrors > 0:
            pieces = (*pieces, *(piece.mirrored for piece in pieces if piece.opacity == 1))
        for number, geom in enumerate(self._distractors):
            self._place(geom, pieces[number] if number < len(pieces) else None)

    def _dress_floor(self, look: SceneLook, brightness: float) -> None:
        material = self._floors[look.floor]
        self._model.geom_matid[self._floor] = material
        self._model.mat_rgba[material, :3] = np.array(look.floor_tint) * brightness
        # What it mirrors stands below it, upside down, and shines through.
        self._model.mat_rgba[material, 3] = 1 - look.floor_mirrors
        mirrors = look.floor_mirrors > 0
        self._model.geom_group[self._mirrored_room] = _SHOWN_GROUP if mirrors else HIDDEN_GROUP
        self._model.mat_specular[material] = look.floor_gloss
        self._model.mat_shininess[material] = 0.3

    def _dress_walls(self, look: SceneLook, brightness: float) -> None:
        model, walls, feet = self._model, self._walls, self._feet
        half = look.wall_height_m / 2
        model.geom_group[walls] = _SHOWN_GROUP if half > 0 else HIDDEN_GROUP
        model.geom_size[walls, 2] = model.geom_pos[walls, 2] = max(half, 1e-3)
        if look.floor_mirrors > 0:
            model.geom_size[walls, 2], model.geom_pos[walls, 2] = 2 * max(half, 1e-3), 0.0
        model.geom_rgba[walls, :3] = np.array(look.wall_rgb) * brightness
        shown = half > 0 and look.foot_height_m > 0
        model.geom_group[feet] = _SHOWN_GROUP if shown else HIDDEN_GROUP
        model.geom_size[feet, 2] = model.geom_pos[feet, 2] = max(look.foot_height_m / 2, 1e-3)
        model.geom_rgba[feet, :3] = np.array(look.foot_rgb) * brightness

    def _dress_object(self, part: "_ObjectPart", look: ObjectLook, brightness: float) -> None:
        model, materials = self._model, part.materials[look.wear]
        model.geom_matid[part.geoms] = materials
        model.mat_rgba[materials, :3] = np.array(look.rgb) * brightness
        if part.thing.mesh is None:  # which has its size in its vertices
            model.geom_size[part.geoms] = part.half_size_m * look.scale
            model.geom_pos[part.geoms, 2] = part.thing.height_m / 2 * look.scale

    def _cast_shadow(self, part: "_ObjectPart", look: SceneLook, scale: float) -> None:
        """A dark patch from the object's foot to where its upper edges shade the floor."""
        model, shadow = self._model, part.shadow
        width, height = part.thing.width_m * scale, part.thing.height_m * scale
        reach, yaw = look.shadow_of(height)
        model.geom_group[shadow] = _SHOWN_GROUP if look.shadow > 0 else HIDDEN_GROUP
        model.geom_rgba[shadow] = (0, 0, 0, look.shadow)
        model.geom_size[shadow] = ((1.1 * width + reach) / 2, 1.1 * width / 2, 5e-4)
        model.geom_pos[shadow, :2] = (reach / 2 * math.cos(yaw), reach / 2 * math.sin(yaw))
        model.geom_quat[shadow] = (math.cos(yaw / 2), 0, 0, math.sin(yaw / 2))

    def _mirror(
        self, part: "_ObjectPart", look: SceneLook, worn: ObjectLook, brightness: float
    ) -> None:
        """Its image in the floor, and what is stuck on it. A mesh has neither."""
        model, plain = self._model, part.thing.mesh is None
        shown = plain and look.floor_mirrors > 0
        model.geom_group[part.mirrored] = _SHOWN_GROUP if shown else HIDDEN_GROUP
        model.geom_group[part.labels] = _SHOWN_GROUP if plain and worn.labelled else HIDDEN_GROUP
        if not plain:
            return
        geom = part.geoms[0]
        model.geom_type[part.mirrored] = model.geom_type[geom]
        model.geom_size[part.mirrored] = model.geom_size[geom]
        model.geom_pos[part.mirrored] = -model.geom_pos[geom]
        model.geom_rgba[part.mirrored, :3] = np.array(worn.rgb) * brightness
        half = part.thing.width_m * worn.scale / 2
        high = part.thing.height_m * worn.scale / 2
        out, wide, tall = _LABEL_SHARES
        for label, size in zip(part.labels, ((out, wide, tall), (wide, out, tall)), strict=True):
            model.geom_size[label] = (size[0] * half, size[1] * half, size[2] * high)
            model.geom_pos[label] = (0, 0, high)
            model.geom_rgba[label] = _LABEL_RGBA

    def _light_up(self, look: SceneLook) -> None:
        model, light = self._model, self._light
        direction = np.array(look.light_direction) / np.linalg.norm(look.light_direction)
        model.light_dir[light] = model.light_dir0[light] = direction
        model.light_diffuse[light] = look.light_rgb
        model.light_specular[light] = look.light_rgb if look.floor_gloss > 0 else 0
        model.vis.headlight.ambient[:] = look.ambient_rgb
        model.mat_rgba[self._room, :3] = look.room_rgb

    def _place(self, geom: int, thing: Distractor | None) -> None:
        model = self._model
        model.geom_group[geom] = HIDDEN_GROUP if thing is None else _SHOWN_GROUP
        if thing is None:
            return
        model.geom_type[geom] = _SHAPES[thing.shape]
        size = thing.half_size_m
        model.geom_size[geom] = (size[0], size[2], 0) if thing.shape == "post" else size
        model.geom_pos[geom] = thing.centre_m
        model.geom_quat[geom] = _turned(thing.yaw_rad, thing.tilt_rad)
        model.geom_matid[geom] = self._finishes[thing.finish] if thing.finish else -1
        model.geom_rgba[geom] = (*thing.rgb, thing.opacity)


def _turned(yaw_rad: float, tilt_rad: float) -> tuple[float, float, float, float]:
    """The quaternion of a tilt about the own y and then a yaw."""
    cos_yaw, sin_yaw = math.cos(yaw_rad / 2), math.sin(yaw_rad / 2)
    cos_tilt, sin_tilt = math.cos(tilt_rad / 2), math.sin(tilt_rad / 2)
    return (cos_yaw * cos_tilt, -sin_yaw * sin_tilt, cos_yaw * sin_tilt, sin_yaw * cos_tilt)


class _ObjectPart:
    """Where one kind of object is in a model, and how large it is nominally."""

    def __init__(self, model: MjModel, kind: int, thing: TargetObject) -> None:
        self.thing = thing
        names = geom_names(kind, thing)
        self.geoms: list[int] = [model.geom(name).id for name in names]
        self.shadow: int = model.geom(shadow_name(kind)).id
        self.mirrored: int = model.geom(mirrored_name(kind)).id
        self.labels: list[int] = [model.geom(name).id for name in label_names(kind)]
        self.extras = (self.shadow, self.mirrored, *self.labels)
        self.materials: list[list[int]] = [
            [model.material(object_material(name, wear)).id for name in names]
            for wear in range(FINISHES)
        ]
        self.half_size_m = model.geom_size[self.geoms].copy()
