"""Simulation and robot see the same rays: a calibrated, distorted camera is drawn by the one and
undone by the other, and what is left is the ideal view the policy was trained on.
"""

from typing import cast

import cv2
import numpy as np
import pytest
from msgspec.structs import replace

from mbot_protocol.drive.camera_model import CameraModel, nominal_pi_camera
from mbot_protocol.drive.picture import Observer, Picture
from mbot_protocol.policy.policy_contract import FULL_VIEW, OBSERVATION_SIDE_PX
from mbot_workstation.learn.worlds.task_env import TaskEnv
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.camera.camera_renderer import CameraRenderer
from mbot_workstation.sim.camera.frame_edges import FrameEdges
from mbot_workstation.sim.pose import ORIGIN, Pose
from mbot_workstation.sim.scene.room_generator import generate_room
from mbot_workstation.sim.simulation import Simulation

from .calibrations import CAMERA
from .scene_geometry import cube_corners, project
from .small_world import ROOMS

ROOM = generate_room(seed=4, width_px=1024)
STRIPES = np.repeat(np.random.default_rng(0).integers(0, 255, (1, 256, 3), np.uint8), 128, axis=0)
"""1.4 degrees wide, any colour: what is at the picture's rim differs from what is beyond it."""
CUBES = (Pose(0.5, 0.1, 0.3), Pose(0.6, -0.2, 0.9), Pose(0.45, 0.0), Pose(1.2, 0.3, 0.2))
IDEAL = CameraModel.from_field_of_view(640, 640, FULL_VIEW.horizontal_deg, FULL_VIEW.vertical_deg)
BARREL = CAMERA.model()
WIDE = replace(BARREL, focal_x_px=1750.0, focal_y_px=1745.0)
"""Sees all of the policy's view."""
NARROW = replace(BARREL, focal_x_px=2150.0, focal_y_px=2140.0)
"""Lacks a rim of it, three pixels wide."""


def frame_of(
    camera: CameraModel, cube: Pose, size: tuple[int, int], room: Picture = ROOM
) -> Picture:
    simulation = Simulation(RobotParameters(camera=camera), room_picture=room)
    simulation.place_robot(ORIGIN)
    simulation.place_object(cube)
    with CameraRenderer(simulation, *size) as renderer:
        return renderer.picture(simulation.snapshot())


def observed(
    camera: CameraModel, cube: Pose, taken_for: CameraModel | None = None, room: Picture = ROOM
) -> Picture:
    """What the daemon makes of a frame of 640 x 480, taking the camera for this one."""
    frame = frame_of(camera, cube, (640, 480), room)
    return Observer((taken_for or camera).scaled_to(640, 480), FULL_VIEW).observe(frame)


def ideal(cube: Pose, room: Picture = ROOM) -> Picture:
    """The policy's view, drawn at ten times its size and averaged."""
    fine = frame_of(IDEAL, cube, (640, 640), room)
    side = OBSERVATION_SIDE_PX
    return cast(Picture, cv2.resize(fine, (side, side), interpolation=cv2.INTER_AREA))


def rms(one: Picture, other: Picture, rim_px: int = 0) -> float:
    inner = slice(rim_px, OBSERVATION_SIDE_PX - rim_px)
    return float(np.sqrt(np.mean((one[inner, inner].astype(float) - other[inner, inner]) ** 2)))


def red_middle(picture: Picture) -> np.ndarray:
    """The middle of what is red, weighted by how red it is; column and row."""
    red, green, blue = np.moveaxis(picture.astype(float), -1, 0)
    weight = np.clip(red - np.maximum(green, blue) - 40, 0, None)
    rows, columns = np.indices(weight.shape)
    return np.array([(weight * columns).sum(), (weight * rows).sum()]) / weight.sum()


@pytest.mark.parametrize("cube", CUBES)
def test_a_calibrated_robot_sees_the_ideal_view(cube: Pose) -> None:
    truth, seen = ideal(cube), observed(WIDE, cube)
    assert np.abs(red_middle(seen) - red_middle(truth)).max() < 0.1
    assert rms(seen, truth) < 6
    uncalibrated = observed(WIDE, cube, nominal_pi_camera(640, 480))
    assert np.abs(red_middle(uncalibrated) - red_middle(truth)).max() > 0.5
    assert rms(uncalibrated, truth) > 1.5 * rms(seen, truth)


@pytest.mark.parametrize("size", [(320, 240), (640, 480), (333, 250)])
def test_frames_show_the_calibrated_camera_at_every_size(size: tuple[int, int]) -> None:
    """The cube's corners lie where OpenCV projects them with the calibration's own numbers."""
    robot = RobotParameters()
    for cube in CUBES:
        frame = frame_of(BARREL, cube, size)
        camera = BARREL.scaled_to(*size)
        corners = project(cube_corners(cube, 0.1), ORIGIN, robot.camera_mount, camera)
        low, high = corners.min(axis=0), corners.max(axis=0)
        if (low < 1).any() or (high > np.array(size) - 2).any():
            continue
        red, green, blue = np.moveaxis(frame.astype(int), -1, 0)
        rows, columns = np.nonzero((red > 90) & (red > 2 * green) & (red > 2 * blue))
        box = [columns.min() - 0.5, rows.min() - 0.5, columns.max() + 0.5, rows.max() + 0.5]
        assert np.allclose(box, (*low, *high), atol=1.1), cube


def test_training_shows_the_rim_that_the_robots_frames_lack() -> None:
    """Of the policy's view NARROW has no pixels for the rim; both sides repeat the last ones."""
    cube = CUBES[0]
    truth, seen = ideal(cube, STRIPES), observed(NARROW, cube, room=STRIPES)
    edges = FrameEdges(NARROW)
    assert edges.are_in_view
    trained_on = edges.apply(truth)
    rim = np.ones(truth.shape, bool)
    rim[3:-3, 3:-3] = False
    unlike = np.abs(truth.astype(float) - seen)[rim].mean()
    like = np.abs(trained_on.astype(float) - seen)[rim].mean()
    assert like < 0.7 * unlike
    assert np.array_equal(trained_on[6:-6, 6:-6], truth[6:-6, 6:-6])


def test_a_camera_that_sees_enough_has_no_rim() -> None:
    for camera in (WIDE, nominal_pi_camera(320, 240), nominal_pi_camera(2028, 1520)):
        edges = FrameEdges(camera)
        assert not edges.are_in_view
        picture = np.zeros((64, 64, 3), np.uint8)
        assert edges.apply(picture) is picture


def test_the_environment_of_a_calibrated_robot_has_its_rim() -> None:
    pictures = []
    for camera in (nominal_pi_camera(320, 240), WIDE, NARROW):
        environment = TaskEnv("ideal", "10", ROOMS, RobotParameters(camera=camera))
        pictures.append(environment.reset(seed=5)[0])
        environment.close()
    nominal, wide, narrow = pictures
    assert np.array_equal(nominal, wide)
    assert not np.array_equal(nominal, narrow)
    assert np.array_equal(nominal[6:-6, 6:-6], narrow[6:-6, 6:-6])
