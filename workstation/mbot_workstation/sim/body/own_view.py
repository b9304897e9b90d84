"""Which of the robot's own parts its camera sees."""

import math
from itertools import product

import numpy as np
from numpy.typing import NDArray

from mbot_workstation.sim.body.robot_mjcf import camera_quaternion
from mbot_workstation.sim.body.robot_parameters import BoxBody, RobotParameters
from mbot_workstation.sim.engine import mujoco

MARGIN_DEG = 4.0
"""Mounts and lenses differ by so much from what was measured (randomised presets: 2.5 degrees of
pitch, 4 % of the view)."""

NEAREST_M = 0.010
"""What is nearer to the lens is not drawn."""

SAMPLES = 15
"""Along each edge of a box: every 12 mm of a chassis."""


def parts_in_view(
    robot: RobotParameters, horizontal_fov_deg: float, vertical_fov_deg: float
) -> list[str]:
    """Names of the bodies of which a piece is in view, or nearly so.

    Args:
        robot: its bodies and camera mount.
        horizontal_fov_deg, vertical_fov_deg: of the camera.

    """
    mount = robot.camera_mount
    lens = np.array([mount.ahead_m, mount.left_m, mount.height_m])
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, camera_quaternion(mount))
    right, up, behind = turn.reshape(3, 3).T
    widest = [
        math.tan(math.radians(fov_deg / 2 + MARGIN_DEG))
        for fov_deg in (horizontal_fov_deg, vertical_fov_deg)
    ]
    seen: list[str] = []
    for body in robot.bodies:
        rays = _surface(body) - lens
        ahead_m = -rays @ behind
        is_ahead = ahead_m > NEAREST_M
        inside = is_ahead & (np.abs(rays @ right) < widest[0] * ahead_m)
        inside &= np.abs(rays @ up) < widest[1] * ahead_m
        # From within a box nothing of it is drawn.
        holds_lens = bool((np.abs(lens - body.centre_m) < np.array(body.size_m) / 2).all())
        if inside.any() and not holds_lens:
            seen.append(body.name)
    return seen


def _surface(body: BoxBody) -> NDArray[np.float64]:
    """Points all over a box and in it. Shape (n, 3)."""
    steps = np.linspace(-0.5, 0.5, SAMPLES)
    grid = np.array(list(product(steps, steps, steps)))
    return np.array(body.centre_m) + grid * body.size_m
