"""Where points of the world appear in the robot camera's picture, by OpenCV alone."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from mbot_protocol.drive.camera_model import CameraModel
from mbot_workstation.sim.body.robot_parameters import CameraMount
from mbot_workstation.sim.pose import Pose


def project(
    points_m: NDArray[np.float64], robot: Pose, mount: CameraMount, camera: CameraModel
) -> NDArray[np.float64]:
    """Shape (n, 3) in the world to (n, 2) in pixels."""
    yaw = robot.yaw_rad
    forward = np.array([math.cos(yaw), math.sin(yaw), 0])
    left = np.array([-math.sin(yaw), math.cos(yaw), 0])
    up = np.array([0.0, 0, 1])
    eye = (
        np.array([robot.x_m, robot.y_m, mount.height_m])
        + forward * mount.ahead_m
        + left * mount.left_m
    )
    pitch = math.radians(mount.pitch_down_deg)
    axis = forward * math.cos(pitch) - up * math.sin(pitch)
    down = -up * math.cos(pitch) - forward * math.sin(pitch)
    rotation = np.stack([-left, down, axis])
    seen = (points_m - eye) @ rotation.T
    pixels, _ = cv2.projectPoints(
        seen, np.zeros(3), np.zeros(3), camera.matrix, np.array(camera.distortion)
    )
    return np.asarray(pixels, np.float64).reshape(-1, 2)


def cube_corners(cube: Pose, edge_m: float) -> NDArray[np.float64]:
    """Shape (8, 3), in the world."""
    half = edge_m / 2
    corners = np.array(
        [(x, y, z) for x in (-half, half) for y in (-half, half) for z in (0, edge_m)]
    )
    cos, sin = math.cos(cube.yaw_rad), math.sin(cube.yaw_rad)
    turned = corners @ np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])
    return turned + np.array([cube.x_m, cube.y_m, 0])
