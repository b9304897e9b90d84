"""The arena from above with the robot's path drawn in."""

import math
from typing import Self

import cv2
import numpy as np

from mbot_protocol.drive.picture import Picture
from mbot_workstation.sim.camera.scene_renderer import Quality, SceneRenderer
from mbot_workstation.sim.pose import Pose
from mbot_workstation.sim.scene.scene_mjcf import (
    OVERHEAD_CAMERA,
    OVERHEAD_FOV_DEG,
    OVERHEAD_HEIGHT_M,
)
from mbot_workstation.sim.simulation import SceneState, Simulation

OVERHEAD = Quality(shadow_map_px=512, samples=0, reflections=False)
"""10 ms at 480 x 480 in software; smooth edges would cost as much again."""

PATH_RGB = (30, 90, 200)
POINT_EVERY_M = 0.02
JUMP_M = 0.3
"""A longer step between two points is the robot being put back: no line is drawn."""


class OverheadView:
    """Draws the arena and the path so far; use it in a `with`, in one thread."""

    def __init__(self, simulation: Simulation, side_px: int, quality: Quality = OVERHEAD) -> None:
        self._side_px = side_px
        self._renderer = SceneRenderer(simulation, OVERHEAD_CAMERA, side_px, side_px, quality)
        self._path: list[Pose] = []

    def to_pixel(self, x_m: float, y_m: float) -> tuple[float, float]:
        """Column and row of a point on the floor; +x is right, +y is up."""
        half_m = OVERHEAD_HEIGHT_M * math.tan(math.radians(OVERHEAD_FOV_DEG) / 2)
        scale = self._side_px / 2 / half_m
        middle = (self._side_px - 1) / 2
        return middle + x_m * scale, middle - y_m * scale

    def draw(self, state: SceneState, robot: Pose) -> Picture:
        """A picture with the path up to here. Shape (side_px, side_px, 3), RGB."""
        if not self._path or _distance_m(self._path[-1], robot) > POINT_EVERY_M:
            self._path.append(robot)
        picture = self._renderer.draw(state)
        points = [self.to_pixel(pose.x_m, pose.y_m) for pose in self._path]
        for piece in _pieces(self._path, points):
            line = np.round(np.array(piece)).astype(np.int32)
            cv2.polylines(picture, [line], False, PATH_RGB, 1, cv2.LINE_AA)
        return picture

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._renderer.close()


def _pieces(path: list[Pose], points: list[tuple[float, float]]) -> list[list[tuple[float, float]]]:
    """Cut the path where the robot was put back to the origin."""
    pieces = [[points[0]]]
    for before, after, point in zip(path, path[1:], points[1:], strict=False):
        if _distance_m(before, after) > JUMP_M:
            pieces.append([])
        pieces[-1].append(point)
    return pieces


def _distance_m(one: Pose, other: Pose) -> float:
    return math.hypot(one.x_m - other.x_m, one.y_m - other.y_m)
