"""What tracking is made of, on drawn pictures."""

import threading
from pathlib import Path

import cv2
import numpy as np
import pytest

from mbot_protocol.drive.camera_model import CameraModel
from mbot_protocol.errors import MbotError
from mbot_workstation.measure.targets.marker_detection import refine_corners
from mbot_workstation.measure.targets.specifications import MARKER_DICTIONARY, ROBOT_MARKER_ID
from mbot_workstation.measure.tracking.floor_plane import plane_from_board, plane_from_corners
from mbot_workstation.measure.tracking.marker_track import (
    MarkerSettings,
    track_marker,
    watch_marker,
)

from .overhead_film import marker_sheet, webcam

CAMERA = webcam()


def picture_with_marker(left: float, top: float, side: float) -> tuple[np.ndarray, np.ndarray]:
    """A marker on a light floor, seen straight from above; and its corners."""
    sheet = marker_sheet()
    height, width = sheet.shape
    reach = side * 0.5  # of paper around it
    source = np.array([[0, 0], [width, 0], [width, height]], np.float32)
    first, last = (left - reach, top - reach), (left + side + reach, top + side + reach)
    place = np.array([first, (last[0], first[1]), last], np.float32)
    turned = cv2.getAffineTransform(source, place)
    grey = cv2.warpAffine(sheet, turned, (640, 480), borderValue=(200,))
    detector = cv2.aruco.ArucoDetector(
        cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, MARKER_DICTIONARY))
    )
    corners, _, _ = detector.detectMarkers(grey)
    return grey, np.asarray(corners[0], np.float64).reshape(4, 2)


def test_corners_become_sharper_than_they_were_found() -> None:
    grey, found = picture_with_marker(200.25, 150.75, 120.0)
    edge = np.linalg.norm(np.diff(np.vstack([found, found[:1]]), axis=0), axis=1).mean()
    moved = found + np.random.default_rng(0).uniform(-0.7, 0.7, (4, 2))
    refined = refine_corners(grey, moved)
    assert refined.shape == (4, 2)
    assert np.abs(refined - found).max() < 0.8
    sides = np.linalg.norm(np.diff(np.vstack([refined, refined[:1]]), axis=0), axis=1)
    assert np.ptp(sides) < 0.02 * edge


def test_a_floor_without_what_marks_it_is_not_found() -> None:
    blank = np.full((CAMERA.height_px, CAMERA.width_px), 128, np.uint8)
    assert plane_from_board(CAMERA, blank, 25.0) is None
    assert plane_from_corners(CAMERA, {}, 3.0, 3.0) is None


def test_a_film_without_the_marker_shows_none() -> None:
    frames = iter([(0.1 * i, np.full((240, 320, 3), 90, np.uint8)) for i in range(5)])

    def camera_for(width_px: int, height_px: int) -> CameraModel:
        return CameraModel.from_field_of_view(width_px, height_px, 60.0, 47.0)

    watches = list(watch_marker(frames, ROBOT_MARKER_ID, camera_for, None))
    assert watches[-1].pictures == 5
    assert len(watches[-1].sights) == 0


def test_a_source_that_is_not_there_leaves_no_track(tmp_path: Path) -> None:
    settings = MarkerSettings(
        marker_id=ROBOT_MARKER_ID,
        edge_m=0.08,
        height_m=0.12,
        camera_for=lambda w, h: CameraModel.from_field_of_view(w, h, 60.0, 47.0),
        camera_is_known=False,
        find_floor=None,
    )
    output = tmp_path / "track.tum"
    with pytest.raises(MbotError, match=r"missing\.mp4"):
        track_marker(str(tmp_path / "missing.mp4"), output, settings, threading.Event())
    assert not output.exists()
