"""What a person would take of the printed board: all over the view, tilted every way."""

from collections.abc import Iterator

import cv2
import numpy as np

from mbot_protocol.drive.camera_model import CameraModel
from mbot_protocol.drive.picture import Picture
from mbot_workstation.measure.rehearsal.photograph import Hold, Sheet, photograph
from mbot_workstation.measure.targets.layouts import board_page
from mbot_workstation.measure.targets.png import draw
from mbot_workstation.measure.targets.sheet import PAPERS
from mbot_workstation.measure.targets.specifications import Board
from mbot_workstation.sim.camera.sensor_noise import SensorNoise

DOTS_A_MM = 8.0
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
    page = draw(board_page(board, PAPERS["a4"]), DOTS_A_MM).astype(np.float32) / 255
    ink = PRINTED_BLACK + (PAPER_WHITE - PRINTED_BLACK) * page
    sheet = Sheet(ink.astype(np.float32), DOTS_A_MM)
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
