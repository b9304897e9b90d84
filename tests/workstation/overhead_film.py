"""A film of a marker that moves on a known path, drawn through a known camera."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from msgspec.structs import replace

from mbot_protocol.drive.camera_model import CameraModel
from mbot_workstation.measure.targets.marker_detection import Grey
from mbot_workstation.measure.targets.specifications import (
    MARKER_DICTIONARY,
    ROBOT_MARKER_ID,
    Board,
    charuco_board,
    marker_cells,
)
from mbot_workstation.measure.tracks.track import Array

FRAME_RATE_HZ = 30.0
CELL_PX = 24


@dataclass(frozen=True)
class Overhead:
    """A camera that looks down aslant."""

    camera: CameraModel
    height_m: float = 2.3
    tilt_deg: float = 12.0

    @property
    def attitude(self) -> Array:
        """Rows: the camera's axes in the world. World: x right, y away, z up."""
        tilt = np.radians(self.tilt_deg)
        ahead = np.array([0.0, np.sin(tilt), -np.cos(tilt)])
        right = np.array([1.0, 0.0, 0.0])
        return np.stack([right, np.cross(ahead, right), ahead])

    @property
    def place_m(self) -> Array:
        return np.array([0.0, -self.height_m * np.tan(np.radians(self.tilt_deg)), self.height_m])

    def pixels(self, points_m: Array) -> Array:
        turned, _ = cv2.Rodrigues(self.attitude)
        moved = -self.attitude @ self.place_m
        found, _ = cv2.projectPoints(
            points_m.reshape(-1, 3),
            turned,
            moved,
            self.camera.matrix,
            np.array(self.camera.distortion),
        )
        return np.asarray(found, dtype=np.float64).reshape(*points_m.shape[:-1], 2)


def webcam(width_px: int = 960, fov_deg: float = 62.0, k1: float = -0.06) -> CameraModel:
    height_px = width_px * 9 // 16
    vertical = 2 * np.degrees(np.arctan(np.tan(np.radians(fov_deg) / 2) * height_px / width_px))
    camera = CameraModel.from_field_of_view(width_px, height_px, fov_deg, float(vertical))
    return replace(camera, distortion=(k1, 0.0, 0.0, 0.0, 0.0))


def marker_sheet(number: int = ROBOT_MARKER_ID) -> Grey:
    """With a white margin of one cell; 8 cells a side."""
    black = np.pad(marker_cells(MARKER_DICTIONARY, number), 1)
    return np.kron(np.where(black, 20, 235), np.ones((CELL_PX, CELL_PX))).astype(np.uint8)


def sheet_corners(pose: Array, side_m: float, height_m: float) -> Array:
    """Corners of a square sheet, clockwise from its upper left, its upper edge ahead. (4, 3)."""
    x, y, yaw = pose
    half = side_m / 2
    own = np.array([[half, half], [half, -half], [-half, -half], [-half, half]])  # ahead, left
    cosine, sine = np.cos(yaw), np.sin(yaw)
    return np.column_stack(
        [
            x + cosine * own[:, 0] - sine * own[:, 1],
            y + sine * own[:, 0] + cosine * own[:, 1],
            np.full(4, height_m),
        ]
    )


def lay(picture: Grey, sheet: Grey, corners_px: Array) -> None:
    """Draw a sheet into a picture, smoothly; straight within itself, which small sheets are."""
    height, width = sheet.shape
    ends = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32) - 0.5
    scale = 4
    low = np.floor(corners_px.min(axis=0)).astype(int) - 2
    high = np.ceil(corners_px.max(axis=0)).astype(int) + 3
    low, high = np.maximum(low, 0), np.minimum(high, picture.shape[::-1])
    if (high <= low).any():
        return
    size = (high - low) * scale
    inside = ((corners_px - low + 0.5) * scale - 0.5).astype(np.float32)
    matrix = cv2.getPerspectiveTransform(ends, inside)
    flags = cv2.INTER_AREA if sheet.shape[0] > size[0] else cv2.INTER_LINEAR
    drawn = cv2.warpPerspective(sheet, matrix, tuple(int(v) for v in size), flags=flags)
    mask = cv2.warpPerspective(np.full_like(sheet, 255), matrix, tuple(int(v) for v in size))
    small = tuple(int(v) for v in high - low)
    cover = cv2.resize(mask, small, interpolation=cv2.INTER_AREA) / 255.0
    content = cv2.resize(drawn.astype(np.float32), small, interpolation=cv2.INTER_AREA)
    part = picture[low[1] : high[1], low[0] : high[0]]
    part[:] = (part * (1 - cover) + content).astype(np.uint8)


def drive(seconds: float) -> tuple[Array, Array]:
    """Times and poses (x, y, yaw): a figure of eight, the front ahead."""
    times_s = np.arange(0, seconds, 1 / FRAME_RATE_HZ)
    phase = 2 * np.pi * times_s / 8.0
    x, y = 0.85 * np.sin(phase), 0.35 * np.sin(2 * phase)
    yaw = np.arctan2(0.7 * np.cos(2 * phase), 0.85 * np.cos(phase))
    return times_s, np.column_stack([x, y, np.unwrap(yaw)])


def film(
    path: Path,
    view: Overhead,
    poses: Array,
    edge_m: float = 0.08,
    height_m: float = 0.11,
    corners_m: tuple[float, float] | None = None,
    board_mm: float | None = None,
    mirrored: bool = False,
    hidden: Sequence[int] = (),
) -> None:
    """Write an AVI file."""
    random = np.random.default_rng(0)
    size = (view.camera.width_px, view.camera.height_px)
    floor = cv2.GaussianBlur(random.normal(150, 40, size[::-1]).astype(np.float32), (0, 0), 3)
    floor = np.clip(floor, 60, 190).astype(np.uint8)
    if corners_m is not None:
        width, depth = corners_m
        for number, x, y in ((1, -1, 1), (2, 1, 1), (3, 1, -1), (4, -1, -1)):
            pose = np.array([x * width / 2, y * depth / 2, np.pi / 2])
            quad = view.pixels(sheet_corners(pose, 0.12 * 8 / 6, 0.0))
            lay(floor, marker_sheet(number), quad)
    if board_mm is not None:
        board = Board(square_mm=board_mm, charuco=True)
        sheet = charuco_board(board).generateImage(
            (board.columns * 60 + 80, board.rows * 60 + 80), marginSize=40
        )
        half = np.array([board.columns * 60 + 80, board.rows * 60 + 80]) / 60 * board_mm / 2000
        flat = np.array([[-1, 1], [1, 1], [1, -1], [-1, -1]]) * half + [0.0, -0.3]
        lay(floor, np.asarray(sheet), view.pixels(np.column_stack([flat, np.zeros(4)])))
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), FRAME_RATE_HZ, size)
    writer.set(cv2.VIDEOWRITER_PROP_QUALITY, 92)
    sheet = marker_sheet()
    noises = [random.normal(0, 3, floor.shape).astype(np.int16) for _ in range(4)]
    for row, pose in enumerate(poses):
        picture = floor.copy()
        if row not in hidden:
            # 8 cells of the sheet for 6 of the marker.
            quad = view.pixels(sheet_corners(pose, edge_m * 8 / 6, height_m))
            lay(picture, sheet, quad)
        noisy = np.clip(picture + noises[row % 4], 0, 255).astype(np.uint8)
        shown = noisy[:, ::-1] if mirrored else noisy
        writer.write(cv2.cvtColor(shown, cv2.COLOR_GRAY2BGR))
    writer.release()
