"""Parts of calibration that the commands' tests only pass through."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from mbot_protocol.drive.camera_model import nominal_pi_camera
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.measure.calibration.body.body_drawing import FRONT, SIDE, TOP
from mbot_workstation.measure.calibration.body.body_files import robot_mjcf, write_mjcf
from mbot_workstation.measure.calibration.camera.board_detection import Sighting, find_board
from mbot_workstation.measure.calibration.camera.camera_drawing import draw_calibration
from mbot_workstation.measure.calibration.camera.camera_fit import fit_camera
from mbot_workstation.measure.calibration.camera.camera_live import collect
from mbot_workstation.measure.calibration.camera.picture_sizes import (
    check_aspects,
    commonest_size,
    scaled_corners,
)
from mbot_workstation.measure.calibration.light.card_outline import (
    find_framed_card,
    find_plain_card,
)
from mbot_workstation.measure.calibration.light.gray_card import CardReading
from mbot_workstation.measure.calibration.light.light_drawing import draw_light
from mbot_workstation.measure.calibration.light.light_fit import LightFit
from mbot_workstation.measure.calibration.light.light_measurement import LightMeasurement
from mbot_workstation.measure.calibration.light.simulated_card import camera_axes, simulated_card
from mbot_workstation.measure.calibration.room.panorama_preview import draw_preview
from mbot_workstation.measure.targets.specifications import Board
from mbot_workstation.pictures.picture_file import picture_files, read_picture
from mbot_workstation.pictures.video_source import VideoSource
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.engine import mujoco
from mbot_workstation.sim.scene.room_generator import generate_room
from mbot_workstation.sim.scene.scene_parameters import Light, SceneParameters

from .board_pictures import photograph, poses
from .test_wide_lens import sightings

BOARD = Board(9, 6, 25.0)
CAMERA = nominal_pi_camera(320, 240)


def sighting(width_px: int, height_px: int) -> Sighting:
    camera = nominal_pi_camera(width_px, height_px)
    rng = np.random.default_rng(0)
    (pose,) = poses(BOARD, camera, 1, rng)
    found = find_board(photograph(BOARD, camera, pose, rng), BOARD)
    assert found is not None
    return Sighting(f"{width_px}.png", (width_px, height_px), found)


def test_a_robot_as_mjcf_compiles_to_the_same_mass(tmp_path: Path) -> None:
    robot = RobotParameters()
    model = mujoco.MjModel.from_xml_string(robot_mjcf(robot))
    assert float(model.body_mass.sum()) == pytest.approx(robot.mass_kg)
    write_mjcf(robot, tmp_path / "robot.xml")
    assert "<mujoco" in (tmp_path / "robot.xml").read_text()
    with pytest.raises(ConfigurationError):
        write_mjcf(robot, tmp_path / "missing" / "robot.xml")


def test_the_body_is_drawn_from_three_sides() -> None:
    views = (SIDE, TOP, FRONT)
    assert len({(view.across, view.up) for view in views}) == 3
    for view in views:
        assert {view.across, view.up, view.towards[0]} == {0, 1, 2}


def test_pictures_of_several_sizes_have_one_scale() -> None:
    small, large = sighting(640, 480), sighting(1280, 960)
    assert commonest_size([small, small, large]) == (640, 480)
    check_aspects([small, large])
    scaled = scaled_corners(small, 1280, 960)
    assert scaled.shape[-1] == 2
    assert np.abs(scaled.max(axis=0)).max() < 1280
    with pytest.raises(ConfigurationError):
        check_aspects([small, Sighting("wide", (640, 360), small.board)])


def test_pictures_are_found_in_folders_and_read_as_grey_or_named(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "b.png"), np.zeros((8, 8, 3), np.uint8))
    cv2.imwrite(str(tmp_path / "a.jpg"), np.zeros((8, 8, 3), np.uint8))
    (tmp_path / "notes.txt").write_text("no picture")
    assert [path.name for path in picture_files([tmp_path])] == ["a.jpg", "b.png"]
    assert read_picture(tmp_path / "b.png").shape[:2] == (8, 8)
    (tmp_path / "broken.png").write_bytes(b"no picture")
    with pytest.raises(ConfigurationError, match=r"broken\.png"):
        read_picture(tmp_path / "broken.png")


def test_a_stream_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(Exception, match=r"missing\.mp4"):
        collect(str(tmp_path / "missing.mp4"), [BOARD], tmp_path, 3, lambda *_: None)
    with (
        pytest.raises(Exception, match=r"missing\.mp4"),
        VideoSource(str(tmp_path / "missing.mp4")),
    ):
        pass
    with pytest.raises(RuntimeError, match="not open"):
        VideoSource("0").read()


def test_a_grey_wall_is_no_card() -> None:
    wall = np.full((240, 320, 3), 120, np.uint8)
    assert find_framed_card(wall, CAMERA, (127.0, 102.0)) is None
    with pytest.raises(ConfigurationError, match=r"wall\.jpg"):
        find_plain_card(wall, "wall.jpg")


def test_a_simulated_card_is_brighter_towards_the_light() -> None:
    robot = RobotParameters()
    light = Light((1.0, 0.0, -0.2), 0.3)
    facing, turned = np.array((-1.0, 0.0, 0.0)), np.array((-0.7, 0.714, 0.0))
    levels = simulated_card(robot, light, (1.0, 1.0, 1.0), 118.0, [facing, turned])
    assert levels.shape == (2, 3)
    assert levels[0].mean() > levels[1].mean() + 5
    axes = camera_axes(robot)
    assert np.allclose(axes @ axes.T, np.eye(3))


def test_a_preview_is_drawn(tmp_path: Path) -> None:
    path = tmp_path / "room.png"
    room = generate_room(0, 256)
    draw_preview(room, RobotParameters(), SceneParameters(), (1.0, 1.0, 1.0), path)
    picture = cv2.imread(str(path))
    assert picture is not None
    assert picture.std() > 20


@pytest.mark.slow
def test_a_calibrated_camera_is_drawn(tmp_path: Path) -> None:
    fit = fit_camera(sightings(8))
    path = tmp_path / "camera.png"
    draw_calibration(fit, path)
    drawn = cv2.imread(str(path))
    assert drawn is not None
    assert drawn.std() > 10
    with pytest.raises(ConfigurationError, match="can't write"):
        draw_calibration(fit, tmp_path / "none" / "camera.png")


def test_a_measured_light_is_drawn_with_what_it_differs_by(tmp_path: Path) -> None:
    grey = np.full((2, 3), 118.0)
    readings = tuple(CardReading(name, grey[0], np.zeros((4, 2)), None) for name in ("a", "b"))
    normals = (np.array([-1.0, 0.0, 0.0]), None)
    light = LightFit(1.0, 1.0, 1.0, Light(), None, "too few")
    apart = np.array([7.1, 0.3])
    measured = LightMeasurement(light, readings, normals, grey, grey, apart, apart, ())
    draw_light(measured, tmp_path / "light.svg")
    text = (tmp_path / "light.svg").read_text()
    for words in ("<!-- 7.1 -->", "<!-- 0.3 -->", "<!-- a -->", "<!-- b -->"):
        assert words in text
