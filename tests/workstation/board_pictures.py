"""Photographs of boards, drawn by ray casting with a camera whose intrinsics are known."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from mbot_protocol.drive.camera_model import CameraModel
from mbot_workstation.measure.targets.layouts import board_page
from mbot_workstation.measure.targets.page_file import draw
from mbot_workstation.measure.targets.sheet import PAPERS
from mbot_workstation.measure.targets.specifications import Board

DOTS_A_MM = 12.0
FINER = 2
"""Rays a pixel along each side, averaged."""


@dataclass(frozen=True)
class Pose:
    """Of a board before the camera: rotation vector, and where its middle is, in metres."""

    turn: tuple[float, float, float]
    middle: tuple[float, float, float]

    @property
    def rotation(self) -> NDArray[np.float64]:
        return np.asarray(cv2.Rodrigues(np.array(self.turn))[0], np.float64)


@cache
def sheet(board: Board) -> tuple[NDArray[np.uint8], tuple[float, float]]:
    """The printed page, and where the board's first square starts on it, in mm."""
    paper = PAPERS["a4"] if board.columns * board.square_mm <= 281 else PAPERS["a3"]
    page = board_page(board, paper)
    squares = page.shapes[0].polygons
    left = min(x for square in squares for x, _ in square)
    top = min(y for square in squares for _, y in square)
    return draw(page, DOTS_A_MM), (left, top)


@cache
def _slopes(camera: CameraModel) -> NDArray[np.float32]:
    fine = camera.scaled_to(camera.width_px * FINER, camera.height_px * FINER)
    rows, columns = np.mgrid[0 : fine.height_px, 0 : fine.width_px].astype(np.float32)
    pixels = np.stack([columns.ravel(), rows.ravel()], axis=-1).reshape(-1, 1, 2)
    exact = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 30, 1e-9)
    slopes = cv2.undistortPoints(pixels, fine.matrix, np.array(fine.distortion), criteria=exact)
    return np.asarray(slopes, np.float32).reshape(fine.height_px, fine.width_px, 2)


def photograph(
    board: Board,
    camera: CameraModel,
    pose: Pose,
    rng: np.random.Generator,
    *,
    blur_px: float = 0.6,
    noise: float = 2.0,
) -> NDArray[np.uint8]:
    """A grey picture. Shape (height, width)."""
    paper, (left, top) = sheet(board)
    slopes = _slopes(camera)
    rotation = pose.rotation
    # The plane's homography from slopes to millimetres from the board's middle.
    to_slopes = np.column_stack([rotation[:, 0], rotation[:, 1], np.array(pose.middle) * 1000])
    back = np.linalg.inv(to_slopes)
    where = slopes @ back[:, :2].T.astype(np.float32) + back[:, 2].astype(np.float32)
    x_mm = where[..., 0] / where[..., 2] + board.columns * board.square_mm / 2 + left
    y_mm = where[..., 1] / where[..., 2] + board.rows * board.square_mm / 2 + top
    behind = where[..., 2] <= 0
    x_mm[behind] = -1e6
    sharp = cv2.remap(
        paper,
        (x_mm * DOTS_A_MM - 0.5).astype(np.float32),
        (y_mm * DOTS_A_MM - 0.5).astype(np.float32),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=(90,),
    )
    picture = cv2.resize(
        sharp, (camera.width_px, camera.height_px), interpolation=cv2.INTER_AREA
    ).astype(np.float32)
    light = np.linspace(0.75, 1.0, camera.width_px, dtype=np.float32)
    picture = cv2.GaussianBlur(20 + 0.8 * picture * light, (0, 0), blur_px)
    picture += rng.normal(0, noise, picture.shape).astype(np.float32)
    return np.clip(picture, 0, 255).astype(np.uint8)


def poses(
    board: Board,
    camera: CameraModel,
    count: int,
    rng: np.random.Generator,
    *,
    tilt_deg: float = 40,
) -> Iterator[Pose]:
    """Where a person would hold a board: all over the view, tilted every way, all of it in view.

    A ChArUco board may stick out.
    """
    long_m = board.columns * board.square_mm / 1000
    made = 0
    while made < count:
        distance = long_m * rng.uniform(1.2, 2.2)
        reach = 0.5 * distance * np.array([camera.width_px, camera.height_px]) / camera.focal_x_px
        side = np.array([made % 2 * 2 - 1, made // 2 % 2 * 2 - 1])
        x, y = reach * side * rng.uniform(0, 0.8, 2)
        axis = rng.uniform(0, 2 * np.pi)
        tilt = np.radians(rng.uniform(0.3, 1) * tilt_deg)
        tilted = cv2.Rodrigues(tilt * np.array([np.cos(axis), np.sin(axis), 0]))[0]
        rolled = cv2.Rodrigues(np.array([0, 0, rng.uniform(-0.4, 0.4)]))[0]
        turn = [float(value) for value in cv2.Rodrigues(tilted @ rolled)[0].ravel()]
        pose = Pose((turn[0], turn[1], turn[2]), (float(x), float(y), float(distance)))
        if board.charuco or _is_in_view(board, camera, pose):
            made += 1
            yield pose


def _is_in_view(board: Board, camera: CameraModel, pose: Pose) -> bool:
    half = np.array([board.columns, board.rows]) * board.square_mm / 2000
    outline = np.array([(x, y, 0) for x in (-half[0], half[0]) for y in (-half[1], half[1])])
    pixels = np.asarray(
        cv2.projectPoints(
            outline,
            np.array(pose.turn),
            np.array(pose.middle),
            camera.matrix,
            np.array(camera.distortion),
        )[0]
    ).reshape(-1, 2)
    size = np.array([camera.width_px, camera.height_px])
    margin = 0.015 * camera.width_px
    return bool((pixels > margin).all() and (pixels < size - margin).all())


def shaken(picture: NDArray[np.uint8], length_px: int) -> NDArray[np.uint8]:
    """Moved to the right and down while it was exposed."""
    kernel = np.eye(length_px, dtype=np.float32) / length_px
    return np.asarray(cv2.filter2D(picture, -1, kernel), np.uint8)


def wobbling(picture: NDArray[np.uint8], amount_px: float) -> NDArray[np.uint8]:
    """Read out row by row while the camera shook."""
    height, width = picture.shape
    phase = np.linspace(0, 2 * np.pi, height, dtype=np.float32)[:, None]
    columns = np.arange(width, dtype=np.float32)[None] + amount_px * np.sin(phase)
    rows = np.arange(height, dtype=np.float32)[:, None] + 0 * columns
    return np.asarray(
        cv2.remap(picture, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE),
        np.uint8,
    )
