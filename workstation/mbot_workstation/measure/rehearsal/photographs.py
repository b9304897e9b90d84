"""Photographs of the rehearsal: board and card through the true lens, frames from marked places."""

import csv
import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from mbot_protocol.drive.camera_model import CameraModel
from mbot_protocol.drive.picture import Picture
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.measure.calibration.light.colour_difference import srgb_level
from mbot_workstation.measure.calibration.light.light_fit import shade
from mbot_workstation.measure.calibration.light.simulated_card import camera_axes
from mbot_workstation.measure.gap_report.frames import CUBE, FRAMES_FILE, ROBOT
from mbot_workstation.measure.gap_report.simulated_view import FramePlace, simulated_view
from mbot_workstation.measure.rehearsal.truth import true_room
from mbot_workstation.measure.targets.layouts import board_page, card_page, card_place
from mbot_workstation.measure.targets.page_file import draw
from mbot_workstation.measure.targets.sheet import PAPERS
from mbot_workstation.measure.targets.specifications import Board
from mbot_workstation.measure.tracks.track import Array
from mbot_workstation.pictures.picture_file import write_picture
from mbot_workstation.sim.calibrated.calibration_folder import CalibrationFiles
from mbot_workstation.sim.camera.sensor_noise import SensorNoise
from mbot_workstation.sim.pose import ORIGIN, Pose

FINER = 2
"""Rays a pixel along each side, averaged: the pixel's own area."""

BLUR_PX = 0.5
"""Standard deviation of a good lens in focus."""

BEHIND_PAGE = 0.30
"""Level of what is around the page: a wall out of focus."""


@dataclass(frozen=True, slots=True, eq=False)
class Sheet:
    """A printed page as a picture: ink, paper and gray cards have no colour of their own.

    Attributes:
        picture: levels in [0, 1], float32, shape (h, w).
        dots_a_mm: its scale.

    """

    picture: NDArray[np.float32]
    dots_a_mm: float

    @property
    def middle_mm(self) -> tuple[float, float]:
        """From the upper left corner."""
        height, width = self.picture.shape
        return width / self.dots_a_mm / 2, height / self.dots_a_mm / 2


@dataclass(frozen=True, slots=True)
class Hold:
    """How the page is held before the camera, in OpenCV's camera frame.

    Attributes:
        turn: rotation vector, page to camera; the page's x is to the right, y down, z into it.
        at_m: of the page's middle.

    """

    turn: tuple[float, float, float]
    at_m: tuple[float, float, float]

    @property
    def rotation(self) -> Array:
        """As a matrix, shape (3, 3)."""
        return np.asarray(cv2.Rodrigues(np.array(self.turn))[0], dtype=np.float64)


def photograph(
    sheet: Sheet, camera: CameraModel, hold: Hold, light: Array, noise: SensorNoise
) -> Picture:
    """Take one.

    Args:
        sheet: the page.
        camera: size and lens.
        hold: where the page is.
        light: levels by which the page's are multiplied, of red, green and blue; shape (3,).
        noise: of a sensor of that size.

    Returns:
        Shape (height_px, width_px, 3), RGB.

    """
    rays = _rays(camera)
    rotation = hold.rotation
    to_rays = np.column_stack([rotation[:, 0], rotation[:, 1], np.array(hold.at_m) * 1000])
    across, down = sheet.middle_mm
    # From millimetres on the page to its dots; the middle of the first is 0, 0.
    dots = sheet.dots_a_mm
    to_dots = np.array([[dots, 0, across * dots - 0.5], [0, dots, down * dots - 0.5], [0, 0, 1]])
    where = cv2.transform(rays, (to_dots @ np.linalg.inv(to_rays)).astype(np.float32))
    columns, rows, depth = (np.asarray(one, np.float32) for one in cv2.split(where))
    depth[depth <= 0] = 1e-9  # behind the camera, so far off the page
    drawn = cv2.remap(
        sheet.picture,
        columns / depth,
        rows / depth,
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=(BEHIND_PAGE,),
    )
    size = camera.width_px, camera.height_px
    grey = cv2.resize(drawn, size, interpolation=cv2.INTER_AREA)
    grey = cv2.GaussianBlur(grey, (0, 0), BLUR_PX)
    sharp = (255 * grey[..., None] * light + 0.5).clip(0, 255).astype(np.uint8)
    return noise.apply(sharp)


@cache
def _rays(camera: CameraModel) -> NDArray[np.float32]:
    """The ray of each fine pixel as x / z, y / z, 1. Shape (rows, columns, 3)."""
    fine = camera.scaled_to(camera.width_px * FINER, camera.height_px * FINER)
    rows, columns = np.mgrid[0 : fine.height_px, 0 : fine.width_px].astype(np.float32)
    pixels = np.stack([columns.ravel(), rows.ravel()], axis=-1).reshape(-1, 1, 2)
    exact = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 30, 1e-9)
    slopes = cv2.undistortPoints(pixels, fine.matrix, np.array(fine.distortion), criteria=exact)
    flat = np.asarray(slopes, np.float32).reshape(fine.height_px, fine.width_px, 2)
    return np.concatenate([flat, np.ones_like(flat[..., :1])], axis=-1)


BOARD_DOTS_A_MM = 8.0
STEEPEST_RAD = np.radians(40)
PRINTED_BLACK, PAPER_WHITE = 0.06, 0.86


def board_photos(camera: CameraModel, count: int, seed: int) -> Iterator[Picture]:
    """Photographs of the default board, as `workstation print board` makes it.

    Args:
        camera: the true one.
        count: how many.
        seed: of positions and noise.

    """
    rng = np.random.default_rng(seed)
    board = Board()
    page = draw(board_page(board, PAPERS["a4"]), BOARD_DOTS_A_MM).astype(np.float32) / 255
    ink = PRINTED_BLACK + (PAPER_WHITE - PRINTED_BLACK) * page
    sheet = Sheet(ink.astype(np.float32), BOARD_DOTS_A_MM)
    noise = SensorNoise(camera.width_px, camera.height_px, seed)
    made = 0
    while made < count:
        hold = _hold(board, camera, made, rng)
        if _is_in_view(board, camera, hold):
            made += 1
            yield photograph(sheet, camera, hold, np.ones(3) * rng.uniform(0.85, 1.0), noise)


def _hold(board: Board, camera: CameraModel, number: int, rng: np.random.Generator) -> Hold:
    """In turn near each corner of the view, at arm's length or nearer."""
    width_m = board.columns * board.square_mm / 1000
    distance_m = width_m * rng.uniform(1.2, 2.1)
    half = np.array([camera.width_px / camera.focal_x_px, camera.height_px / camera.focal_y_px])
    side = np.array([number % 2 * 2 - 1, number // 2 % 2 * 2 - 1])
    x_m, y_m = distance_m * half / 2 * side * rng.uniform(0, 0.95, 2)
    way = rng.uniform(0, 2 * np.pi)
    tilt = STEEPEST_RAD * rng.uniform(0.25, 1)
    tilted = cv2.Rodrigues(tilt * np.array([np.cos(way), np.sin(way), 0.0]))[0]
    rolled = cv2.Rodrigues(np.array([0.0, 0.0, rng.uniform(-0.4, 0.4)]))[0]
    a, b, c = (float(value) for value in cv2.Rodrigues(tilted @ rolled)[0].ravel())
    return Hold((a, b, c), (float(x_m), float(y_m), float(distance_m)))


def _is_in_view(board: Board, camera: CameraModel, hold: Hold) -> bool:
    """Whether all of the board is, with something to spare."""
    across, down = np.array([board.columns, board.rows]) * board.square_mm / 2000
    corners = np.array([(x, y, 0.0) for x in (-across, across) for y in (-down, down)])
    pixels = cv2.projectPoints(
        corners,
        np.array(hold.turn),
        np.array(hold.at_m),
        camera.matrix,
        np.array(camera.distortion),
    )[0].reshape(-1, 2)
    margin = 0.015 * camera.width_px
    size = np.array([camera.width_px, camera.height_px])
    return bool((pixels > margin).all() and (pixels < size - margin).all())


CARD_DOTS_A_MM = 6.0
CARD_MM = (127.0, 102.0)
REFLECTANCE = 0.18
PAPER_WHITE = 0.95

DISTANCE_M = 0.52

TURNS_DEG = ((0, 0), (40, 0), (-40, 0), (0, 45), (30, 35), (-30, 35), (0, -25))
"""How far the card is turned to the robot's left and tilted up in each photograph."""

CARD_PHOTO_PX = 1014, 760


def card_photos(truth: CalibrationFiles, seed: int) -> Iterator[Picture]:
    """One for each of `TURNS_DEG`, by the robot's own camera at its start."""
    robot, effects = truth.robot, truth.effects
    camera = robot.camera.scaled_to(*CARD_PHOTO_PX)
    gains = effects.exposure_gain * np.array([effects.red_gain, 1.0, effects.blue_gain])
    sheet = _sheet()
    noise = SensorNoise(*CARD_PHOTO_PX, seed)
    for left_deg, up_deg in TURNS_DEG:
        # Page to camera: x to the right, y down, z into the page, away from the camera.
        turn = _about((0, 1, 0), left_deg) @ _about((1, 0, 0), -up_deg)
        a, b, c = (float(value) for value in cv2.Rodrigues(turn)[0].ravel())
        normal = camera_axes(robot) @ -turn[:, 2]
        light = gains * shade(normal, truth.scene.light)
        yield photograph(sheet, camera, Hold((a, b, c), (0.0, 0.0, DISTANCE_M)), light, noise)


def _sheet() -> Sheet:
    """The printed frame with the card lying in it."""
    paper = PAPERS["a4"]
    page = card_page(CARD_MM, paper)
    levels = (draw(page, CARD_DOTS_A_MM) / 255 * PAPER_WHITE).astype(np.float32)
    left, top, width, height = card_place(paper.height_mm, paper.width_mm)
    first = np.array([left + (width - CARD_MM[0]) / 2, top + (height - CARD_MM[1]) / 2])
    (x, y), (right, bottom) = (
        np.round(corner * CARD_DOTS_A_MM).astype(int) for corner in (first, first + CARD_MM)
    )
    levels[y:bottom, x:right] = srgb_level(REFLECTANCE) / 255
    return Sheet(levels, CARD_DOTS_A_MM)


def _about(axis: tuple[int, int, int], angle_deg: float) -> Array:
    vector = np.radians(angle_deg) * np.array(axis, dtype=np.float64)
    return np.asarray(cv2.Rodrigues(vector)[0], dtype=np.float64)


FRAME_PX = 640, 480

PLACES = (
    FramePlace(ORIGIN, Pose(0.9, 0.15, math.radians(20))),
    FramePlace(Pose(0.5, -0.5, math.radians(120)), Pose(0.2, 0.7, 0.0)),
    FramePlace(Pose(-0.8, 0.3, math.radians(-140))),
)


def take_frames(folder: Path, truth: CalibrationFiles, seed: int) -> None:
    """Write a picture from each of `PLACES`, and frames.csv.

    Raises:
        ConfigurationError: the folder can't be written.

    """
    noise = SensorNoise(*FRAME_PX, seed)
    rows: list[list[str]] = []
    with simulated_view(truth, true_room(), FRAME_PX) as draw:
        for number, place in enumerate(PLACES, start=1):
            name = f"frame-{number}.jpg"
            write_picture(folder / name, noise.apply(draw(place)))
            rows.append([name, *_fields(place.robot), *(_fields(place.cube) or [""] * len(CUBE))])
    try:
        with (folder / FRAMES_FILE).open("w", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerows([["file", *ROBOT, *CUBE], *rows])
    except OSError as error:
        raise ConfigurationError(f"can't write to {folder}: {error.strerror}") from None


def _fields(pose: Pose | None) -> list[str]:
    if pose is None:
        return []
    return [f"{pose.x_m:g}", f"{pose.y_m:g}", f"{math.degrees(pose.yaw_rad):g}"]
