"""Photographs of a gray card in its printed frame, turned every way, in the room's true light."""

from collections.abc import Iterator

import cv2
import numpy as np

from mbot_protocol.drive.picture import Picture
from mbot_workstation.measure.calibration.light.colour_difference import srgb_level
from mbot_workstation.measure.calibration.light.simulated_card import camera_axes
from mbot_workstation.measure.rehearsal.photograph import Hold, Sheet, photograph
from mbot_workstation.measure.targets.layouts import card_page, card_place
from mbot_workstation.measure.targets.png import draw
from mbot_workstation.measure.targets.sheet import PAPERS
from mbot_workstation.sim.calibrated.calibration_folder import CalibrationFiles
from mbot_workstation.sim.camera.sensor_noise import SensorNoise
from mbot_workstation.sim.scene.scene_parameters import Light
from mbot_workstation.sim.track import Array

DOTS_A_MM = 6.0
CARD_MM = (127.0, 102.0)
REFLECTANCE = 0.18
PAPER_WHITE = 0.95

DISTANCE_M = 0.52

TURNS_DEG = ((0, 0), (40, 0), (-40, 0), (0, 45), (30, 35), (-30, 35), (0, -25))
"""How far the card is turned to the robot's left and tilted up in each photograph."""

WIDTH_PX, HEIGHT_PX = 1014, 760


def card_photos(truth: CalibrationFiles, seed: int) -> Iterator[Picture]:
    """One for each of `TURNS_DEG`, by the robot's own camera at its start."""
    robot, effects = truth.robot, truth.effects
    camera = robot.camera.scaled_to(WIDTH_PX, HEIGHT_PX)
    gains = effects.exposure_gain * np.array([effects.red_gain, 1.0, effects.blue_gain])
    sheet = _sheet()
    noise = SensorNoise(WIDTH_PX, HEIGHT_PX, seed)
    for left_deg, up_deg in TURNS_DEG:
        # Page to camera: x to the right, y down, z into the page, away from the camera.
        turn = _about((0, 1, 0), left_deg) @ _about((1, 0, 0), -up_deg)
        a, b, c = (float(value) for value in cv2.Rodrigues(turn)[0].ravel())
        normal = camera_axes(robot) @ -turn[:, 2]
        light = gains * _shade(normal, truth.scene.light)
        yield photograph(sheet, camera, Hold((a, b, c), (0.0, 0.0, DISTANCE_M)), light, noise)


def _sheet() -> Sheet:
    """The printed frame with the card lying in it."""
    paper = PAPERS["a4"]
    page = card_page(CARD_MM, paper)
    levels = (draw(page, DOTS_A_MM) / 255 * PAPER_WHITE).astype(np.float32)
    left, top, width, height = card_place(paper.height_mm, paper.width_mm)
    first = np.array([left + (width - CARD_MM[0]) / 2, top + (height - CARD_MM[1]) / 2])
    (x, y), (right, bottom) = (
        np.round(corner * DOTS_A_MM).astype(int) for corner in (first, first + CARD_MM)
    )
    levels[y:bottom, x:right] = srgb_level(REFLECTANCE) / 255
    return Sheet(levels, DOTS_A_MM)


def _about(axis: tuple[int, int, int], angle_deg: float) -> Array:
    vector = np.radians(angle_deg) * np.array(axis, dtype=np.float64)
    return np.asarray(cv2.Rodrigues(vector)[0], dtype=np.float64)


def _shade(normal: Array, light: Light) -> float:
    """The simulation's matte surface: what the virtual room does to any colour in it."""
    towards = -np.array(light.direction) / np.linalg.norm(light.direction)
    return light.ambient + (1 - light.ambient) * max(0.0, float(normal @ towards))
