"""Lenses that five coefficients can't follow to the corners."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from mbot_protocol.drive.calibration import CameraCalibration, read_camera
from mbot_protocol.drive.camera_model import CameraModel
from mbot_protocol.drive.lens import folds_in_view, folds_within, ray_slope
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.policy.policy_contract import FULL_VIEW
from mbot_workstation.measure.calibration.camera.board_detection import FoundBoard, Sighting
from mbot_workstation.measure.calibration.camera.camera_fit import (
    CameraFit,
    PictureFit,
    fit_camera,
    solve,
)
from mbot_workstation.measure.calibration.camera.camera_quality import judge, view_deg
from mbot_workstation.sim.calibrated.calibration_folder import write_camera
from mbot_workstation.sim.camera.lens_distortion import covering_pinhole

SIZE = (1280, 960)
FOCAL_PX = 560.0
"""An equidistant lens, r = f theta: 131 degrees across; no polynomial of it is exact."""


def sightings(
    count: int = 30, seed: int = 0, *, focal_px: float = FOCAL_PX, part: float = 1.0
) -> list[Sighting]:
    """8 x 6 corners all over the picture, or in the middle of it only, to 0.1 px."""
    rng = np.random.default_rng(seed)
    columns, rows = np.meshgrid(np.arange(8.0), np.arange(6.0))
    board = 0.03 * np.stack([columns.ravel(), rows.ravel(), np.zeros(48)], axis=1)
    middle = board.mean(axis=0)
    matrix = np.array([[focal_px, 0, 641.0], [0, focal_px, 478.0], [0, 0, 1]])
    found: list[Sighting] = []
    while len(found) < count:
        turn = rng.normal(0, 0.35, 3)
        place = np.array(
            [rng.uniform(-0.35, 0.35), rng.uniform(-0.26, 0.26), rng.uniform(0.2, 0.4)]
        )
        rotation = cv2.Rodrigues(turn)[0]
        corners, _ = cv2.fisheye.projectPoints(
            (board - middle)[None], turn, place, matrix, np.zeros(4)
        )
        pixels = corners.reshape(-1, 2) + rng.normal(0, 0.1, (48, 2))
        in_front = ((board - middle) @ rotation.T + place)[:, 2].min() > 0.05
        edge = (1 - part) / 2 * np.array(SIZE) + 2
        inside = (pixels > edge).all() and (pixels < np.array(SIZE) - 1 - edge).all()
        if in_front and inside:
            one = FoundBoard(board.astype(np.float32), pixels.astype(np.float32), None)
            found.append(Sighting(f"{len(found)}.png", SIZE, one))
    return found


def calibration(camera: CameraModel) -> CameraCalibration:
    return CameraCalibration(
        *(camera.width_px, camera.height_px, camera.focal_x_px, camera.focal_y_px),
        *(camera.principal_x_px, camera.principal_y_px, camera.distortion),
        reprojection_error_px=0.2,
        pictures=30,
        made_on="2026-11-22",
    )


@pytest.mark.slow
def test_a_wide_lens_is_followed_to_its_corners_and_written(tmp_path: Path) -> None:
    fit = fit_camera(sightings())
    assert len(fit.camera.distortion) == 8
    assert fit.deviations.shape == (12,)
    assert fit.error_px < 0.25
    assert not folds_within(fit.camera)
    write_camera(tmp_path, calibration(fit.camera))
    read = read_camera(tmp_path)
    assert read is not None
    assert read.model() == fit.camera
    # Where the true lens sees a ray 40 degrees off the axis, so does the fitted one.
    ray = np.array([[np.tan(np.radians(40)), 0.0, 1.0]])
    seen, _ = cv2.projectPoints(
        ray, np.zeros(3), np.zeros(3), fit.camera.matrix, np.array(fit.camera.distortion)
    )
    assert seen.ravel() == pytest.approx((641 + FOCAL_PX * np.radians(40), 478), abs=1.5)
    assert view_deg(fit.camera)[0] == pytest.approx(np.degrees(1280 / FOCAL_PX), abs=0.5)
    pinhole = covering_pinhole(fit.camera)
    assert pinhole.width_px > SIZE[0]


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_what_bends_where_no_board_was_seen_is_left_out(seed: int) -> None:
    """80 degrees across, boards in the middle four fifths: eight coefficients had a fold or a pole
    right behind, and a view of 69 degrees."""
    some = sightings(18, seed, focal_px=640 / np.radians(40), part=0.8)
    camera = fit_camera(some).camera
    assert not folds_within(camera)
    assert view_deg(camera)[0] == pytest.approx(80, abs=1)


@pytest.mark.parametrize(
    "distortion", [(-0.3, 0.1, 0, 0, -0.02), (0.2, 0.05, 0, 0, 0, 0.5, 0.1, 0)]
)
def test_the_view_is_as_the_lens_shows_it(distortion: tuple[float, ...]) -> None:
    camera = CameraModel(1280, 960, 900, 900, 630.0, 470.0, distortion)
    edges = np.array([[-0.5, 470.0], [1279.5, 470.0], [630.0, -0.5], [630.0, 959.5]])
    exact = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-12)
    rays = cv2.undistortPoints(edges, camera.matrix, np.array(distortion), criteria=exact)
    angles = np.degrees(np.arctan(np.linalg.norm(rays.reshape(4, 2), axis=1)))
    assert view_deg(camera) == pytest.approx((angles[:2].sum(), angles[2:].sum()), abs=0.01)


def test_a_ray_beyond_a_fold_is_the_last_one_before_it() -> None:
    bent = CameraModel(1280, 960, 560, 560, 639.5, 479.5, (-0.33, 0.0, 0.0, 0.0, 0.0))
    assert ray_slope(bent, 0.1) == pytest.approx(0.1003, abs=1e-4)
    assert ray_slope(bent, 5.0) == pytest.approx(1 / np.sqrt(3 * 0.33), abs=2e-3)
    straight = CameraModel(1280, 960, 560, 560, 639.5, 479.5)
    assert ray_slope(straight, 7.0) == 7.0


@pytest.mark.parametrize(("share", "words"), [(0.009, ""), (0.012, "note"), (0.021, "objection")])
def test_a_focal_length_that_is_known_to_a_percent_and_a_bit_is_taken(
    share: float, words: str
) -> None:
    corners = np.zeros((4, 2), np.float32)
    board = FoundBoard(np.zeros((4, 3), np.float32), corners, None)
    pose = np.array([0, 0, 0, 0, 0, 0.5])
    picture = PictureFit(Sighting("a", SIZE, board), 0.1, True, pose, np.zeros((4, 2)))
    camera = CameraModel(*SIZE, 900, 900, 640, 480)
    quality = judge(CameraFit(camera, np.full(9, share * 450), (picture,) * 9, 1.0, True))
    assert any("focal length" in one for one in quality.objections) == (words == "objection")
    assert any("focal length" in one for one in quality.notes) == (words == "note")


def test_pictures_that_are_no_camera_are_refused_in_one_line() -> None:
    start = CameraModel(*SIZE, FOCAL_PX, FOCAL_PX, 640.0, 480.0)
    with pytest.raises(ConfigurationError, match="these pictures fit no camera"):
        solve([], start)


def test_a_fold_beyond_what_a_policy_sees_is_no_reason_to_refuse() -> None:
    far = CameraModel(1280, 960, 560, 560, 639.5, 479.5, (-0.33, 0.0, 0.0, 0.0, 0.0))
    near = CameraModel(1280, 960, 560, 560, 639.5, 479.5, (-0.9, 0.1, 0.0, 0.0, 0.0))
    assert folds_within(far)
    assert not folds_in_view(far, FULL_VIEW)
    assert calibration(far).model() == far
    assert folds_in_view(near, FULL_VIEW)
    with pytest.raises(ValueError, match="the part of its picture that a policy needs"):
        calibration(near)


def test_distortions_of_another_length_are_refused() -> None:
    with pytest.raises(ValueError, match="distortion has 4 numbers, expected 5"):
        CameraModel(640, 480, 600, 600, 320, 240, (0.1, 0.0, 0.0, 0.0))
