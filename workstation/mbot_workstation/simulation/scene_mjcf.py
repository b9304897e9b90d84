"""The whole model: floor, walls, cube, room and light around the robot."""

import numpy as np

from mbot_protocol.picture import Picture
from mbot_workstation.simulation.engine import MjModel, MjSpec, mujoco
from mbot_workstation.simulation.floor_texture import TILE_SIDE_M, vinyl
from mbot_workstation.simulation.robot_mjcf import (
    FLOOR_BIT,
    ROBOT,
    WALL_BIT,
    add_robot,
    resist_turning,
)
from mbot_workstation.simulation.robot_parameters import RobotParameters
from mbot_workstation.simulation.room_dome import dome_mesh
from mbot_workstation.simulation.scene_parameters import Arena, Cube, Light, Room, SceneParameters
from mbot_workstation.simulation.timestep import TIMESTEP_S

CUBE, ROOM, OVERHEAD_CAMERA = "cube", "room", "overhead camera"

OVERHEAD_HEIGHT_M = 5.0
OVERHEAD_FOV_DEG = 63.0
"""Sees +-3.06 m: the arena with its walls."""

NEAREST_M, FARTHEST_M = 0.01, 20.0
"""What the cameras draw; the cube's face is 30 mm from the camera when it is touched."""

SHADOW_REACH_M = 1.6
"""Half the side of the square around the robot in which shadows are drawn; beyond, the shadow of
a 10 cm cube is a few pixels."""


def build_model(robot: RobotParameters, scene: SceneParameters, room_picture: Picture) -> MjModel:
    """Compile the MuJoCo model.

    Args:
        robot: the robot.
        scene: what is around it.
        room_picture: shape (h, 2 h, 3), RGB, equirectangular; its width a multiple of 4.

    """
    spec = mujoco.MjSpec()
    spec.option.timestep = TIMESTEP_S
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    _set_visuals(spec, scene.light)
    _add_floor(spec, scene.room)
    _add_walls(spec, scene.arena)
    _add_cube(spec, scene.cube)
    _add_room(spec, scene.room, room_picture)
    add_robot(spec, robot)
    _add_light(spec, scene.light)
    _add_overhead_camera(spec)
    model = spec.compile()
    resist_turning(model, robot)
    return model


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


def _add_floor(spec: MjSpec, room: Room) -> None:
    _add_texture(spec, "vinyl", vinyl(seed=0))
    material = spec.add_material(
        name="vinyl", specular=0, texuniform=True, texrepeat=[1 / TILE_SIDE_M] * 2, reflectance=0.04
    )
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "vinyl"
    spec.worldbody.add_geom(
        name="floor",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[room.distance_m, room.distance_m, 1],
        material="vinyl",
        contype=FLOOR_BIT,
        conaffinity=0,
        castshadow=False,  # nothing is below it, and it would shade itself in stripes
    )


def _add_texture(spec: MjSpec, name: str, picture: Picture) -> None:
    height, width, channels = picture.shape
    texture = spec.add_texture(
        name=name,
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        width=width,
        height=height,
        nchannel=channels,
    )
    texture.data = np.ascontiguousarray(picture).tobytes()


def _add_walls(spec: MjSpec, arena: Arena) -> None:
    thickness = 0.02
    middle, half = arena.wall_m + thickness / 2, arena.wall_height_m / 2
    for name, x, y in (("+x", 1, 0), ("-x", -1, 0), ("+y", 0, 1), ("-y", 0, -1)):
        long = arena.wall_m + thickness
        spec.worldbody.add_geom(
            name=f"wall {name}",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=[thickness / 2 if x else long, thickness / 2 if y else long, half],
            pos=[x * middle, y * middle, half],
            rgba=[*arena.wall_rgb, 1],
            contype=WALL_BIT,
            conaffinity=0,
            castshadow=False,  # a wall's shadow would come and go with the shadows' reach
        )


def _add_cube(spec: MjSpec, cube: Cube) -> None:
    spec.add_material(
        name=CUBE, rgba=[*(c / 255 for c in cube.colour_srgb), 1], specular=0, shininess=0
    )
    body = spec.worldbody.add_body(name=CUBE, mocap=True, pos=[1, 0, 0])
    half = cube.edge_m / 2
    body.add_geom(
        name=CUBE,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[half, half, half],
        pos=[0, 0, half],
        material=CUBE,
        mass=0,
        contype=0,  # the task decides about touching; the cube is taken away at once
        conaffinity=0,
    )


def _add_room(spec: MjSpec, room: Room, picture: Picture) -> None:
    _add_texture(spec, ROOM, picture)
    # Emission alone saturates the light on it: the photo is shown as it was taken.
    material = spec.add_material(name=ROOM, emission=1, specular=0)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = ROOM
    dome = dome_mesh(room)
    spec.add_mesh(
        name=ROOM,
        uservert=dome.vertices_m.ravel(),
        usertexcoord=dome.texture.ravel(),
        userface=dome.triangles.ravel(),
        userfacetexcoord=dome.triangles.ravel(),
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,  # it encloses no volume
    )
    body = spec.worldbody.add_body(name=ROOM, mocap=True)
    body.add_geom(
        name=ROOM,
        type=mujoco.mjtGeom.mjGEOM_MESH,
        meshname=ROOM,
        material=ROOM,
        mass=0,
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
