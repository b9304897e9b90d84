import json
import threading
import time
from collections.abc import Sequence
from functools import cache, partial
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from numpy.typing import NDArray

from mbot_protocol.drive.calibration import read_camera
from mbot_protocol.drive.camera_model import CameraModel
from mbot_protocol.errors import ConfigurationError, UnreachableError
from mbot_workstation.cli.calibrate_camera import camera as camera_command
from mbot_workstation.measure.calibration.camera.board_detection import (
    MOST_BEND,
    FoundBoard,
    Sighting,
    bend,
    find_board,
    most_likely_checkerboard,
)
from mbot_workstation.measure.calibration.camera.camera_fit import CameraFit, fit_camera, solve
from mbot_workstation.measure.calibration.camera.camera_live import (
    STILL_S,
    BoardCollector,
    FrameVerdict,
)
from mbot_workstation.measure.calibration.camera.camera_pictures import look_for_boards
from mbot_workstation.measure.calibration.camera.camera_quality import judge
from mbot_workstation.measure.calibration.camera.picture_sizes import ScaledBoard, error_px
from mbot_workstation.measure.targets.specifications import Board
from mbot_workstation.virtual.mjpeg_server import MjpegServer

from .board_pictures import photograph, poses, shaken, wobbling
from .called import output_of

FULL = CameraModel(2028, 1520, 1935.5, 1930.0, 1030.2, 742.6, (-0.08, 0.03, 0.0008, -0.0006, 0.0))
"""The robot's camera in its usual mode, somewhat off its nominal values."""
HALF = FULL.scaled_to(1014, 760)
SMALL = FULL.scaled_to(640, 480)

CHECKERBOARD, CHARUCO = Board(), Board(charuco=True)


@cache
def pictures(board: Board, camera: CameraModel, count: int, seed: int = 0) -> list[NDArray]:
    rng = np.random.default_rng(seed)
    return [
        photograph(board, camera, pose, rng, blur_px=0.8)
        for pose in poses(board, camera, count, rng)
    ]


def sighting(picture: NDArray, board: Board, name: str) -> Sighting:
    found = find_board(picture, board)
    assert found is not None, name
    return Sighting(name, (picture.shape[1], picture.shape[0]), found)


@cache
def seen(board: Board, camera: CameraModel, count: int, seed: int = 0) -> list[Sighting]:
    made = pictures(board, camera, count, seed)
    return [sighting(p, board, f"{camera.width_px}-{n}.png") for n, p in enumerate(made)]


def opencv_fit(sightings: Sequence[Sighting]) -> tuple[float, NDArray]:
    """What OpenCV makes of all pictures: its error, and its camera matrix."""
    error, matrix, *_ = cv2.calibrateCamera(
        [one.board.points_m for one in sightings],
        [one.board.corners_px for one in sightings],
        sightings[0].size,
        None,  # pyright: ignore[reportArgumentType, reportCallIssue]
        None,  # pyright: ignore[reportArgumentType]
    )
    return error, matrix


def intrinsics_of(camera: CameraModel) -> NDArray[np.float64]:
    """As a fit's deviations are ordered."""
    axis = camera.principal_x_px, camera.principal_y_px
    return np.array([camera.focal_x_px, camera.focal_y_px, *axis, *camera.distortion])


def worst_share(fit: CameraFit, truth: CameraModel = FULL) -> float:
    """The largest deviation of focal lengths, relative, and of the axis, in picture widths."""
    truth = truth.scaled_to(fit.camera.width_px, fit.camera.height_px)
    off = (intrinsics_of(fit.camera) - intrinsics_of(truth))[:4]
    return float(np.abs(off / [truth.focal_x_px, truth.focal_y_px, *[truth.width_px] * 2]).max())


@pytest.mark.slow
@pytest.mark.parametrize(("board", "count"), [(CHECKERBOARD, 16), (CHARUCO, 12)])
def test_intrinsics_are_found_to_a_thousandth(board: Board, count: int) -> None:
    fit = fit_camera(seen(board, HALF, count))
    assert worst_share(fit) < 0.001
    assert fit.camera.distortion[0] == pytest.approx(-0.08, abs=0.005)
    off = np.abs(intrinsics_of(fit.camera) - intrinsics_of(HALF))
    assert (off[:8] < 4 * fit.deviations[:8]).all(), "the deviations must be true"
    assert judge(fit).objections == ()


@pytest.mark.slow
def test_several_resolutions_make_one_camera_at_the_largest() -> None:
    mixed = [*seen(CHECKERBOARD, HALF, 16)[:8], *seen(CHECKERBOARD, SMALL, 8)]
    fit = fit_camera(mixed)
    assert (fit.camera.width_px, fit.camera.height_px) == (1014, 760)
    assert worst_share(fit) < 0.001


@pytest.mark.slow
def test_spoiled_pictures_are_left_out_and_the_rest_beats_opencv() -> None:
    good = seen(CHECKERBOARD, HALF, 16)
    bad = pictures(CHECKERBOARD, HALF, 6, seed=5)
    spoiled = [
        *(sighting(wobbling(p, 6), CHECKERBOARD, f"wobbling-{n}") for n, p in enumerate(bad[:4])),
        *(sighting(shaken(p, 9), CHECKERBOARD, f"shaken-{n}") for n, p in enumerate(bad[4:])),
        swapped(good[3], "swapped"),
    ]
    fit = fit_camera([*good, *spoiled])
    left_out = {picture.sighting.name for picture in fit.pictures if not picture.kept}
    assert {one.name for one in spoiled if "shaken" not in one.name} <= left_out
    assert len(left_out - {one.name for one in spoiled}) <= 1
    assert worst_share(fit) < 0.001
    error, matrix = opencv_fit([*good, *spoiled])
    assert fit.error_px < error / 5
    assert abs(matrix[0, 0] / HALF.focal_x_px - 1) > 5 * worst_share(fit)


def swapped(good: Sighting, name: str) -> Sighting:
    """Two rows of corners taken for each other."""
    corners = good.board.corners_px.copy()
    corners[:9], corners[18:27] = corners[18:27].copy(), corners[:9].copy()
    return Sighting(name, good.size, FoundBoard(good.board.points_m, corners, None))


@pytest.mark.slow
def test_with_outliers_kept_the_error_is_no_worse_than_opencvs() -> None:
    bad = [swapped(one, "swapped") for one in seen(CHECKERBOARD, HALF, 16)[:1]]
    for some in (seen(CHECKERBOARD, HALF, 16), seen(CHECKERBOARD, HALF, 16)[1:] + bad):
        fit = fit_camera(some, keep_outliers=True)
        assert all(picture.kept for picture in fit.pictures)
        assert fit.error_px <= opencv_fit(some)[0] * 1.0001


def test_a_cropped_sensor_mode_is_named() -> None:
    cropped = [
        Sighting(f"crop-{n}.png", (1332, 990), one.board)
        for n, one in enumerate(seen(CHECKERBOARD, HALF, 16)[:3])
    ]
    with pytest.raises(ConfigurationError, match=r"3 pictures of 1332 x 990.*crop-0.*crops to 38"):
        fit_camera([*seen(CHECKERBOARD, HALF, 16), *cropped])


@pytest.mark.parametrize("zoom", [0.8, 1.4])
def test_a_crop_of_the_same_shape_is_found_by_its_boards(zoom: float) -> None:
    other = replace(SMALL, focal_x_px=SMALL.focal_x_px * zoom, focal_y_px=SMALL.focal_y_px * zoom)
    with pytest.raises(ConfigurationError, match=r"640 x 480.*another view.*times as long"):
        fit_camera([*seen(CHECKERBOARD, HALF, 16), *seen(CHECKERBOARD, other, 4, seed=7)])


def flipped(picture: NDArray, axis: int) -> NDArray[np.uint8]:
    return np.ascontiguousarray(np.flip(picture, axis))


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("board", [CHECKERBOARD, CHARUCO])
def test_a_mirrored_picture_is_told_from_one_upside_down(board: Board, axis: int) -> None:
    camera, count = (HALF, 12) if board.charuco else (SMALL, 8)
    for picture in pictures(board, camera, count)[:2]:
        for turned in (picture, np.rot90(picture), flipped(flipped(picture, 0), 1)):
            found = find_board(np.ascontiguousarray(turned), board)
            assert found is not None
            assert found.mirrored is False
        found = find_board(flipped(picture, axis), board)
        assert found is not None
        assert found.mirrored is True


def test_mirrored_pictures_are_refused_by_name(tmp_path: Path) -> None:
    paths = saved(tmp_path, pictures(CHARUCO, HALF, 12)[:3])
    (turned,) = saved(tmp_path / "flipped", [flipped(pictures(CHARUCO, HALF, 12)[3], 1)])
    with pytest.raises(ConfigurationError, match=r"1 of 4 pictures, such as 00\.png.*mirrored"):
        look_for_boards([*paths, turned], [])


@pytest.mark.slow
def test_a_file_that_is_no_picture_is_left_out_by_name(tmp_path: Path) -> None:
    paths = saved(tmp_path, pictures(CHARUCO, FULL, 3))
    broken = tmp_path / "broken.png"
    broken.write_bytes(paths[0].read_bytes()[:200])
    found = look_for_boards([broken, *paths], [])
    assert (found.unreadable, len(found.sightings)) == (("broken.png",), 3)
    with pytest.raises(ConfigurationError, match="is not a picture"):
        look_for_boards([broken], [])


def test_an_odd_checkerboard_cannot_tell_a_mirror_and_says_so() -> None:
    odd = Board(10, 7)
    assert not odd.tells_mirrored
    found = find_board(pictures(odd, HALF, 4)[0], odd)
    assert found is not None
    assert found.mirrored is None


def test_a_board_whose_rim_was_taken_for_a_row_is_told_by_its_bend() -> None:
    for picture in pictures(CHECKERBOARD, SMALL, 8):
        found = find_board(picture, CHECKERBOARD)
        assert found is not None
        columns, rows = CHECKERBOARD.inner_corners
        grid = found.corners_px.reshape(rows, columns, 2)
        assert bend(grid) < MOST_BEND / 2
        assert bend(grid.swapaxes(0, 1)) == pytest.approx(bend(grid))
        rim = grid[:, :1] + 0.4 * (grid[:, :1] - grid[:, 1:2])
        assert bend(np.concatenate([rim, grid[:, :-1]], axis=1)) > MOST_BEND


def test_the_size_of_a_checkerboard_is_found() -> None:
    assert most_likely_checkerboard(pictures(Board(10, 7), HALF, 4)) == Board(10, 7)
    assert most_likely_checkerboard([np.full((240, 320), 128, np.uint8)]) is None


def test_small_pictures_do_too() -> None:
    tiny = FULL.scaled_to(320, 240)
    fit = fit_camera(seen(CHECKERBOARD, tiny, 14))
    assert worst_share(fit) < 0.002


@pytest.mark.slow
def test_boards_held_the_same_way_are_objected_to() -> None:
    rng = np.random.default_rng(1)
    upright = [
        sighting(photograph(CHECKERBOARD, SMALL, pose, rng), CHECKERBOARD, f"{n}.png")
        for n, pose in enumerate(poses(CHECKERBOARD, SMALL, 9, rng, tilt_deg=3))
    ]
    words = "; ".join(judge(fit_camera(upright)).objections)
    assert "always held the same way" in words
    again = [seen(CHECKERBOARD, HALF, 16)[0]] * 12
    words = "; ".join(judge(fit_camera(again)).objections)
    assert "12 pictures show 1 different poses" in words
    assert "and lower right of the view" in words


def test_too_few_pictures_are_refused() -> None:
    with pytest.raises(ConfigurationError, match="found in 2 pictures, expected at least 3"):
        fit_camera(seen(CHECKERBOARD, HALF, 16)[:2])


@settings(max_examples=15)
@given(
    focal=st.floats(0.5, 2.0),
    squeeze=st.floats(0.9, 1.1),
    axis=st.tuples(st.floats(-0.05, 0.05), st.floats(-0.05, 0.05)),
    radial=st.tuples(st.floats(-0.15, 0.05), st.floats(-0.02, 0.05)),
    seed=st.integers(0, 1000),
)
def test_exact_corners_give_the_exact_camera(
    focal: float,
    squeeze: float,
    axis: tuple[float, float],
    radial: tuple[float, float],
    seed: int,
) -> None:
    camera = CameraModel(
        1000,
        750,
        1000 * focal,
        1000 * focal * squeeze,
        500 + 1000 * axis[0],
        375 + 1000 * axis[1],
        (*radial, 0.001, -0.001, 0.0),
    )
    rng = np.random.default_rng(seed)
    points = CHECKERBOARD.corner_points().astype(float) - [0.1, 0.08, 0]
    views = []
    for pose in poses(CHARUCO, camera, 8, rng):
        corners, _ = cv2.projectPoints(
            points,
            np.array(pose.turn),
            np.array(pose.middle),
            camera.matrix,
            np.array(camera.distortion),
        )
        views.append(ScaledBoard(points, np.asarray(corners, np.float64).reshape(-1, 2), 1.0))
    found, _ = solve(views, CameraModel(1000, 750, 1000 * focal * 1.08, 1000 * focal, 499.5, 374.5))
    np.testing.assert_allclose(intrinsics_of(found)[:4], intrinsics_of(camera)[:4], rtol=1e-4)
    assert max(error_px(view, found) for view in views) < 1e-3


def saved(folder: Path, made: Sequence[NDArray]) -> list[Path]:
    folder.mkdir(exist_ok=True)
    paths = [folder / f"{number:02d}.png" for number in range(len(made))]
    for path, picture in zip(paths, made, strict=True):
        cv2.imwrite(str(path), picture)
    return paths


run = partial(output_of, camera_command)


@pytest.mark.slow
def test_the_command_writes_what_the_robot_reads(tmp_path: Path) -> None:
    saved(tmp_path / "photos", pictures(CHECKERBOARD, SMALL, 14, seed=2))
    folder = tmp_path / "calibration"
    said = run(str(tmp_path / "photos"), "--calibration", str(folder))
    assert " of 14 pictures" in said
    found = read_camera(folder)
    assert found is not None
    assert found.model().focal_x_px == pytest.approx(SMALL.focal_x_px, rel=0.001)
    assert found.pictures >= 12
    assert cv2.imread(str(folder / "camera.png")) is not None
    fields = json.loads(run(str(tmp_path / "photos"), "--calibration", str(folder), "--json"))
    assert fields["camera"]["focal_x_px"] == pytest.approx(found.focal_x_px)
    assert fields["path"] == str(folder / "camera.toml")
    assert sum(picture["kept"] for picture in fields["pictures"]) == found.pictures


@pytest.mark.slow
def test_a_poor_set_is_not_written_unless_forced(tmp_path: Path) -> None:
    saved(tmp_path / "photos", pictures(CHECKERBOARD, SMALL, 14, seed=2)[:5])
    folder = tmp_path / "calibration"
    options = [str(tmp_path / "photos"), "--calibration", str(folder)]
    with pytest.raises(ConfigurationError, match=r"too poor to be used: \d pictures show"):
        run(*options)
    assert read_camera(folder) is None
    assert (folder / "camera-refused.png").exists()
    run(*options, "--force")
    assert read_camera(folder) is not None


@pytest.mark.slow
def test_bad_input_is_named(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    text = tmp_path / "notes.jpg"
    text.write_text("no picture")
    (grey,) = saved(tmp_path / "grey", [np.full((240, 320), 128, np.uint8)])
    for arguments, message in (
        ([], "either photographs or --live"),
        ([str(grey), "--live", "0"], "either photographs or --live"),
        ([str(tmp_path / "none.png")], "No such file"),
        ([str(tmp_path / "empty")], "holds no pictures"),
        ([str(text)], "is not a picture"),
        ([str(grey)], "no checkerboard or ChArUco board in any of 1 pictures.*10 x 8 squares"),
        ([str(grey), "--inner-corners", "9"], "expected COLUMNSxROWS"),
        ([str(grey), "--inner-corners", "1x1"], "expected 4 to 30"),
        ([str(grey), "--dictionary", "5X5"], "no ArUco dictionary '5X5'"),
        ([str(grey), "--dictionary", "DICT_4X4_50", "--inner-corners", "20x20"], "has 50 markers"),
    ):
        with pytest.raises(ConfigurationError, match=message):
            run(*arguments, "--calibration", str(tmp_path / "calibration"))
    two = [str(path) for path in saved(tmp_path / "two", pictures(CHECKERBOARD, SMALL, 8)[:2])]
    with pytest.raises(ConfigurationError, match=r"there is a .*--inner-corners 9x7"):
        run(*two, "--inner-corners", "8x6", "--calibration", str(tmp_path / "calibration"))
    with pytest.raises(UnreachableError, match="can't open the camera"):
        run("--live", str(tmp_path / "none.mp4"), "--calibration", str(tmp_path / "calibration"))


def test_pictures_are_taken_when_the_board_is_still_and_somewhere_else() -> None:
    one, other, *_ = pictures(CHECKERBOARD, SMALL, 8)
    collector = BoardCollector([CHECKERBOARD])
    blank = np.full(one.shape, 128, np.uint8)
    assert collector.offer(blank, 0.0) is FrameVerdict.NO_BOARD
    assert collector.offer(one, 1.0) is FrameVerdict.MOVING
    assert collector.offer(one, 1.0 + STILL_S / 2) is FrameVerdict.MOVING
    assert collector.offer(one, 1.1 + STILL_S) is FrameVerdict.TAKEN
    assert collector.offer(one, 3.0) is FrameVerdict.SAME_POSE
    assert collector.offer(other, 4.0) is FrameVerdict.MOVING
    assert collector.offer(other, 5.0) is FrameVerdict.TAKEN
    assert collector.offer(flipped(one, 1), 6.0) is FrameVerdict.MIRRORED
    assert collector.count == 2
    assert len(collector.empty_areas()) < 9


@pytest.mark.slow
def test_a_running_stream_is_calibrated(tmp_path: Path) -> None:
    shown = [cv2.imencode(".jpg", p)[1].tobytes() for p in pictures(CHECKERBOARD, SMALL, 8)]
    done = threading.Event()

    def show() -> None:
        while not done.is_set():
            taken = len(list(tmp_path.glob("camera-pictures/*.png")))
            server.publish(shown[taken % len(shown)])
            time.sleep(0.04)

    with MjpegServer() as server:
        thread = threading.Thread(target=show)
        thread.start()
        try:
            options = ["--live", server.url, "--count", "3", "--force"]
            said = run(*options, "--calibration", str(tmp_path))
        finally:
            done.set()
            thread.join()
    kept = list((tmp_path / "camera-pictures").glob("live-*.png"))
    assert len(kept) >= 3
    assert "pictures in" in said
    assert read_camera(tmp_path) is not None
