import json
import math
from pathlib import Path

import numpy as np
import pytest

from mbot_protocol.drive.camera_model import nominal_pi_camera
from mbot_workstation.cli.presenter import plain
from mbot_workstation.measure.calibration.camera.board_detection import FoundBoard, Sighting
from mbot_workstation.measure.calibration.camera.camera_fit import CameraFit, PictureFit
from mbot_workstation.measure.calibration.camera.camera_pictures import SeenBoards
from mbot_workstation.measure.calibration.camera.camera_quality import CameraQuality
from mbot_workstation.measure.calibration.camera.camera_result import camera_lines, camera_result
from mbot_workstation.measure.targets.specifications import Board

CAMERA = nominal_pi_camera(640, 480)
QUALITY = CameraQuality((), ("half a view",), ("top left",), poses=5, tilt_deg=40.0)


def picture(name: str, *, kept: bool) -> PictureFit:
    """30 degrees to the camera, half a metre away, 0.5 px off."""
    corners = np.zeros((4, 2), np.float32)
    board = FoundBoard(np.zeros((4, 3), np.float32), corners, None)
    pose = np.array([math.radians(30), 0, 0, 0, 0, 0.5])
    return PictureFit(Sighting(name, (640, 480), board), 0.5, kept, pose, np.full((4, 2), 0.5**1.5))


FIT = CameraFit(
    CAMERA, np.full(9, 0.25), (picture("a.jpg", kept=True), picture("b.jpg", kept=False)), 0.4, True
)
SEEN = SeenBoards(
    tuple(one.sighting for one in FIT.pictures), ("c.jpg", *"efghi"), (Board(10, 7),), ("d.txt",)
)


def test_programs_are_told_what_people_are() -> None:
    told = json.loads(json.dumps(plain(camera_result(SEEN, FIT, QUALITY, Path("camera.toml")))))
    assert told["path"] == "camera.toml"
    assert told["reprojection_error_px"] == pytest.approx(0.5)
    assert [(one["name"], one["kept"]) for one in told["pictures"]] == [
        ("a.jpg", True),
        ("b.jpg", False),
    ]
    assert (told["pictures"][0]["distance_m"], told["pictures"][0]["tilt_deg"]) == (0.5, 30.0)
    assert told["without_board"] == ["c.jpg", *"efghi"]


def test_each_picture_that_is_not_in_the_fit_is_accounted_for() -> None:
    said = "\n".join(camera_lines(SEEN, FIT, QUALITY))
    assert "over 1 of 2 pictures" in said
    assert "left out 1 of 2 pictures, whose errors are above 0.400 px" in said
    assert "note: half a view" in said
    assert "left out, not pictures: d.txt" in said
    assert "no board found in c.jpg, e, f, g, h and 1 more" in said
    assert "is its own mirror image" in said
    assert f"focal length {CAMERA.focal_x_px:.2f} +- 0.50" in said
