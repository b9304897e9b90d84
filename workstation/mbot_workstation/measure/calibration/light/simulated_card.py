"""A gray card in the simulation, as the robot's camera sees it: what a calibration is judged by."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mbot_workstation.sim.body.robot_mjcf import camera_quaternion
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.camera.camera_renderer import CameraRenderer
from mbot_workstation.sim.camera.isp import IspSettings
from mbot_workstation.sim.engine import mujoco
from mbot_workstation.sim.scene.object_mjcf import object_name
from mbot_workstation.sim.scene.scene_parameters import Light, SceneParameters
from mbot_workstation.sim.scene.target_object import Shape, TargetObject
from mbot_workstation.sim.simulation import SceneState, Simulation

Values = NDArray[np.float64]

AHEAD_M = 0.35
"""Of the camera, on its axis."""

EDGE_M = 0.04
"""Small enough to stay above the floor however it is turned."""

WIDTH_PX, HEIGHT_PX = 320, 240
_HALF_PATCH_PX = 5


def simulated_card(
    robot: RobotParameters,
    light: Light,
    gains: tuple[float, float, float],
    level: float,
    normals: Sequence[Values],
) -> Values:
    """Mean levels of a gray card held before the robot's camera. Shape (n, 3), 0 to 255.

    The scene's cube stands in for the card: gray, and turned so that one of its faces has the
    card's normal.

    Args:
        robot: whose camera looks, from the arena's middle along +x.
        light: to be seen in.
        gains: of red, green and blue.
        level: sRGB level of the card under full light.
        normals: out of the card in the arena's axes, shape (3,) each; towards the camera.

    """
    grey = round(level)
    gray = TargetObject("card", Shape.CUBE, EDGE_M, EDGE_M, (grey, grey, grey))
    scene = SceneParameters(objects=(gray,), light=light)
    simulation = Simulation(robot, scene)
    start = simulation.snapshot()
    card: int = simulation.model.body(object_name()).mocapid[0]
    found: list[Values] = []
    with CameraRenderer(simulation, WIDTH_PX, HEIGHT_PX, isp=IspSettings(gains=gains)) as renderer:
        for normal in normals:
            picture = renderer.picture(_turned(start, card, robot, normal))
            row, column = _axis_px(robot)
            patch = picture[
                row - _HALF_PATCH_PX : row + _HALF_PATCH_PX + 1,
                column - _HALF_PATCH_PX : column + _HALF_PATCH_PX + 1,
            ]
            found.append(patch.reshape(-1, 3).mean(axis=0))
    return np.array(found)


def _axis_px(robot: RobotParameters) -> tuple[int, int]:
    camera = robot.camera.scaled_to(WIDTH_PX, HEIGHT_PX)
    return round(camera.principal_y_px), round(camera.principal_x_px)


def _turned(state: SceneState, card: int, robot: RobotParameters, normal: Values) -> SceneState:
    """The scene with the cube's face that looks along its own -x at the card's place."""
    mount = robot.camera_mount
    eye = np.array([mount.ahead_m, mount.left_m, mount.height_m])
    middle = eye + AHEAD_M * camera_axes(robot)[:, 2]
    turn = _turn_of_face(normal)
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, turn.ravel())
    face = np.array([-EDGE_M / 2, 0, EDGE_M / 2])  # its middle, from the cube's lower middle
    places, turns = state.moved_pos.copy(), state.moved_quat.copy()
    places[card] = middle - turn @ face
    turns[card] = quaternion
    return replace(state, moved_pos=places, moved_quat=turns)


def _turn_of_face(normal: Values) -> Values:
    """A rotation matrix that takes -x to the normal. Shape (3, 3)."""
    ahead = -normal / np.linalg.norm(normal)
    # Any direction across will do, and the axis the normal is farthest from is never along it.
    left = np.cross(np.eye(3)[np.argmin(np.abs(ahead))], ahead)
    left /= np.linalg.norm(left)
    return np.column_stack([ahead, left, np.cross(ahead, left)])


def camera_axes(robot: RobotParameters) -> Values:
    """OpenCV's camera axes in the arena, the robot at its start: columns right, down,
    away. Shape (3, 3).
    """
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, camera_quaternion(robot.camera_mount))
    return turn.reshape(3, 3) * np.array([1, -1, -1])  # MuJoCo's y is up, its z backwards
