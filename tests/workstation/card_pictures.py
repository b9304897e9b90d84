"""Photographs of a gray card in its printed frame, drawn by the simulation under a given light."""

from dataclasses import dataclass, replace
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from mbot_protocol.drive.camera_model import nominal_pi_camera
from mbot_protocol.drive.picture import Picture
from mbot_workstation.measure.targets.layouts import card_page, card_place
from mbot_workstation.measure.targets.page_file import draw
from mbot_workstation.measure.targets.sheet import PAPERS
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.camera.camera_renderer import CameraRenderer
from mbot_workstation.sim.camera.isp import IspSettings
from mbot_workstation.sim.camera.sensor_noise import SensorNoise
from mbot_workstation.sim.engine import mujoco
from mbot_workstation.sim.pose import ORIGIN
from mbot_workstation.sim.scene.object_mjcf import object_name
from mbot_workstation.sim.scene.scene_parameters import Light, SceneParameters
from mbot_workstation.sim.scene.target_object import Shape, TargetObject
from mbot_workstation.sim.simulation import Simulation

from .scene_geometry import project

ROBOT = RobotParameters()
WIDTH_PX, HEIGHT_PX = 640, 480
EDGE_M = 0.10
LEVEL = 118
"""sRGB level of 18 % gray."""
MIDDLE_M = np.array([0.50, 0.0, 0.085])
"""Of the card, half a metre before the robot."""
DOTS_A_MM = 4.0
PAPER = 235


@dataclass(frozen=True)
class Facing:
    """Degrees to the robot's left of facing the robot, and up."""

    left: float
    up: float

    @property
    def axes(self) -> NDArray[np.float64]:
        """Columns: into the card, to the robot's left along it, up along it."""
        left, up = np.radians([self.left, self.up])
        into = np.array([np.cos(up) * np.cos(left), -np.cos(up) * np.sin(left), -np.sin(up)])
        along = np.array([np.sin(left), np.cos(left), 0.0])
        return np.column_stack([into, along, np.cross(into, along)])

    @property
    def normal(self) -> NDArray[np.float64]:
        return -self.axes[:, 0]


@cache
def _frame() -> NDArray[np.uint8]:
    return draw(card_page((EDGE_M * 1000, EDGE_M * 1000), PAPERS["a4"]), DOTS_A_MM)


def photographs(
    light: Light,
    gains: tuple[float, float, float],
    facings: list[Facing],
    *,
    framed: bool = True,
) -> list[Picture]:
    """RGB pictures of the robot's camera, with noise."""
    card = TargetObject("card", Shape.CUBE, EDGE_M, EDGE_M, (LEVEL, LEVEL, LEVEL))
    scene = SceneParameters(objects=(card,), light=light)
    simulation = Simulation(ROBOT, scene)
    start = simulation.snapshot()
    place = simulation.model.body(object_name()).mocapid[0]
    noise = SensorNoise(WIDTH_PX, HEIGHT_PX, seed=1)
    taken = []
    with CameraRenderer(simulation, WIDTH_PX, HEIGHT_PX, isp=IspSettings(gains=gains)) as renderer:
        for facing in facings:
            places, turns = start.moved_pos.copy(), start.moved_quat.copy()
            places[place] = MIDDLE_M - facing.axes @ [-EDGE_M / 2, 0, EDGE_M / 2]
            quaternion = np.empty(4)
            mujoco.mju_mat2Quat(quaternion, facing.axes.ravel())
            turns[place] = quaternion
            picture = renderer.picture(replace(start, moved_pos=places, moved_quat=turns))
            taken.append(noise.apply(_with_frame(picture, facing) if framed else picture))
    return taken


def _with_frame(picture: Picture, facing: Facing) -> Picture:
    """Lay the printed frame around the card, in the card's plane."""
    sheet = _frame()
    height_mm, width_mm = (side / DOTS_A_MM for side in sheet.shape)
    left, top, width, height = card_place(width_mm, height_mm)
    middle = np.array([left + width / 2, top + height / 2])
    corners_mm = np.array([(0, 0), (width_mm, 0), (width_mm, height_mm), (0, height_mm)])
    right, down = ((corners_mm - middle) / 1000).T
    places = MIDDLE_M - np.outer(right, facing.axes[:, 1]) - np.outer(down, facing.axes[:, 2])
    camera = nominal_pi_camera(WIDTH_PX, HEIGHT_PX)
    pixels = project(places, ORIGIN, ROBOT.camera_mount, camera)
    plane = cv2.getPerspectiveTransform(
        (corners_mm * DOTS_A_MM - 0.5).astype(np.float32), pixels.astype(np.float32)
    )
    size = (WIDTH_PX, HEIGHT_PX)
    laid = cv2.warpPerspective(sheet, plane, size, flags=cv2.INTER_AREA)
    cover = np.full(sheet.shape, 255, np.uint8)
    half = EDGE_M * 500
    hole = np.round((middle[:, None] + [[-half, half], [-half, half]]) * DOTS_A_MM).astype(int)
    cover[hole[1, 0] : hole[1, 1], hole[0, 0] : hole[0, 1]] = 0
    covered = cv2.warpPerspective(cover, plane, size, flags=cv2.INTER_NEAREST) > 0
    result = picture.copy()
    result[covered] = (laid[covered].astype(float) * PAPER / 255).astype(np.uint8)[:, None]
    return result
