"""The whole model: floor, walls, objects, room and light around the robot."""

import itertools
import math
from collections.abc import Sequence

import numpy as np

from mbot_protocol.drive.picture import Picture
from mbot_workstation.sim.body.robot_mjcf import (
    HIDDEN_GROUP,
    ROBOT,
    WALL_BIT,
    add_floor_contacts,
    add_robot,
)
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.engine import TIMESTEP_S, MjModel, MjSpec, mujoco
from mbot_workstation.sim.scene.floor_textures import FloorTexture, vinyl
from mbot_workstation.sim.scene.material_mjcf import add_material
from mbot_workstation.sim.scene.object_mjcf import add_distractors, add_object
from mbot_workstation.sim.scene.room_dome import dome_mesh
from mbot_workstation.sim.scene.scene_parameters import (
    Arena,
    FloorMark,
    Light,
    Room,
    SceneParameters,
)

FLOOR, ROOM, OVERHEAD_CAMERA = "floor", "room", "overhead camera"
MIRRORED_ROOM = "room mirrored"
"""What a floor that mirrors shows of it."""

WALL_THICKNESS_M = 0.02
TAPE_M = 0.001
"""Thick enough for a renderer to tell it from the floor, too thin to be seen from the side."""

FOOT_DEPTH_M = 0.004
"""How far a wall's foot stands out."""

OVERHEAD_HEIGHT_M = 5.0
OVERHEAD_FOV_DEG = 63.0
"""Sees +-3.06 m: the arena with its walls."""

NEAREST_M, FARTHEST_M = 0.01, 20.0
"""What the cameras draw; an object is 30 mm from the camera when it is touched."""

SHADOW_REACH_M = 1.6
"""Half the side of the square around the robot in which shadows are drawn; beyond, the shadow of
a 10 cm object is a few pixels."""


def floor_material(index: int) -> str:
    """The name of a floor's material."""
    return f"floor {index}"


def build_model(
    robot: RobotParameters,
    scene: SceneParameters,
    room_picture: Picture,
    floors: Sequence[FloorTexture] = (),
) -> MjModel:
    """Compile the MuJoCo model.

    Args:
        robot: the robot.
        scene: what is around it.
        room_picture: shape (h, 2 h, 3), RGB, equirectangular; its width a multiple of 4.
        floors: further floors, which a look can choose from 1 on; 0 is the nominal vinyl.

    """
    spec = mujoco.MjSpec()
    spec.option.timestep = TIMESTEP_S
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    _set_visuals(spec, scene.light)
    _add_floor(spec, scene.room, [vinyl(), *floors])
    _add_walls(spec, scene.arena)
    for number, mark in enumerate(scene.marks):
        _add_mark(spec, number, mark)
    for kind, thing in enumerate(scene.objects):
        add_object(spec, kind, thing)
    add_distractors(spec)
    _add_room(spec, scene.room, room_picture)
    add_robot(spec, robot)
    add_floor_contacts(spec, FLOOR, robot)
    _add_light(spec, scene.light)
    _add_overhead_camera(spec)
    return spec.compile()


def _set_visuals(spec: MjSpec, light: Light) -> None:
    spec.stat.extent = 1.0  # so that the visual distances below are metres
    spec.stat.center = [0, 0, 0.1]
    spec.visual.map.znear = NEAREST_M
    spec.visual.map.zfar = FARTHEST_M
    spec.visual.map.shadowclip = SHADOW_REACH_M
    # The ambient light belongs to the headlight: MuJoCo takes away a light's own ambient part in
    # its shadow, and adds it twice to what glows by itself.
    spec.visual.headlight.ambient = [light.ambient] * 3
    spec.visual.headlight.diffuse = [0, 0, 0]
    spec.visual.headlight.specular = [0, 0, 0]


def _add_floor(spec: MjSpec, room: Room, floors: Sequence[FloorTexture]) -> None:
    for index, floor in enumerate(floors):
        name = floor_material(index)
        add_material(spec, name, floor.picture, reflectance=0.04)
        spec.material(name).texuniform = True
        spec.material(name).texrepeat = [1 / floor.side_m] * 2
    spec.worldbody.add_geom(
        name=FLOOR,
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        # The last is how far apart MuJoCo's renderer cuts it: light from afar needs no cuts, and a
        # training picture of a floor in squares of 1 m takes a tenth longer (measured).
        size=[room.distance_m, room.distance_m, 2 * room.distance_m],
        material=floor_material(0),
        contype=0,
        conaffinity=0,
        castshadow=False,  # nothing is below it, and it would shade itself in stripes
    )


def _add_mark(spec: MjSpec, number: int, mark: FloorMark) -> None:
    """Flat boxes from point to point, each half a width longer so that corners close."""
    for piece, ((x0, y0), (x1, y1)) in enumerate(itertools.pairwise(mark.points_m)):
        half_yaw = math.atan2(y1 - y0, x1 - x0) / 2
        spec.worldbody.add_geom(
            name=f"mark {number} {piece}",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=[(math.hypot(x1 - x0, y1 - y0) + mark.width_m) / 2, mark.width_m / 2, TAPE_M / 2],
            pos=[(x0 + x1) / 2, (y0 + y1) / 2, TAPE_M / 2],
            quat=[math.cos(half_yaw), 0, 0, math.sin(half_yaw)],
            rgba=[*mark.rgb, 1],
            contype=0,
            conaffinity=0,
            castshadow=False,
        )


def _add_walls(spec: MjSpec, arena: Arena) -> None:
    for sign in ("+x", "-x", "+y", "-y"):
        _add_board(spec, f"wall {sign}", sign, arena, arena.wall_height_m, arena.wall_rgb, 0.0)
        _add_board(spec, f"foot {sign}", sign, arena, 0.002, (0.0, 0.0, 0.0), FOOT_DEPTH_M)


def _add_board(
    spec: MjSpec,
    name: str,
    side: str,
    arena: Arena,
    height_m: float,
    rgb: tuple[float, float, float],
    further_in_m: float,
) -> None:
    """A board along one side of the arena, its inner face so far further in than the wall."""
    thickness = WALL_THICKNESS_M + further_in_m
    middle, half = arena.wall_m + thickness / 2 - further_in_m, height_m / 2
    long = arena.wall_m + WALL_THICKNESS_M
    along_x = side[1] == "x"
    x, y = (int(side[0] + "1"), 0) if along_x else (0, int(side[0] + "1"))
    is_foot = further_in_m > 0
    spec.worldbody.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[thickness / 2 if along_x else long, long if along_x else thickness / 2, half],
        pos=[x * middle, y * middle, half],
        rgba=[*rgb, 1],
        group=HIDDEN_GROUP if is_foot else 0,
        contype=0 if is_foot else WALL_BIT,
        conaffinity=0,
        castshadow=False,  # a wall's shadow would come and go with the shadows' reach
    )


def _add_room(spec: MjSpec, room: Room, picture: Picture) -> None:
    add_material(spec, ROOM, picture)
    # Emission alone saturates the light on it: the photo is shown as it was taken.
    spec.material(ROOM).emission = 1
    body = spec.worldbody.add_body(name=ROOM, mocap=True)
    dome = dome_mesh(room)
    for name, vertices_m, triangles in (
        (ROOM, dome.vertices_m, dome.triangles),
        (
            MIRRORED_ROOM,
            dome.vertices_m * np.array([1, 1, -1], np.float32),
            dome.triangles[:, ::-1],
        ),
    ):
        spec.add_mesh(
            name=name,
            uservert=vertices_m.ravel(),
            usertexcoord=dome.texture.ravel(),
            userface=triangles.ravel(),
            userfacetexcoord=triangles.ravel(),
            inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,  # it encloses no volume
        )
        body.add_geom(
            name=name,
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=name,
            material=ROOM,
            mass=0,
            group=0 if name == ROOM else HIDDEN_GROUP,
            contype=0,
            conaffinity=0,
            castshadow=False,
        )


def _add_light(spec: MjSpec, light: Light) -> None:
    direct = 1 - light.ambient
    direction = np.array(light.direction) / np.linalg.norm(light.direction)
    # It shines in parallel, so its place only says around what shadows are drawn: it follows the
    # robot without turning with it.
    spec.body(ROBOT).add_light(
        name="window",
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        mode=mujoco.mjtCamLight.mjCAMLIGHT_TRACK,
        pos=-3.0 * direction,
        dir=direction,
        ambient=[0, 0, 0],
        diffuse=[direct] * 3,
        specular=[0, 0, 0],
        castshadow=True,
    )


def _add_overhead_camera(spec: MjSpec) -> None:
    # MuJoCo's unrotated camera looks down with +y up in the picture.
    spec.worldbody.add_camera(
        name=OVERHEAD_CAMERA, pos=[0, 0, OVERHEAD_HEIGHT_M], fovy=OVERHEAD_FOV_DEG
    )
