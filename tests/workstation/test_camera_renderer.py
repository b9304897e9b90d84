from collections.abc import Iterator

import cv2
import numpy as np
import pytest
from msgspec.structs import replace

from mbot_protocol.drive.camera_model import CameraModel, nominal_pi_camera
from mbot_protocol.drive.picture import Picture
from mbot_workstation.sim.body.robot_parameters import CameraMount, RobotParameters
from mbot_workstation.sim.camera.camera_renderer import CameraRenderer, Shutter
from mbot_workstation.sim.camera.isp import IspSettings
from mbot_workstation.sim.camera.scene_renderer import SHOW, TRAINING
from mbot_workstation.sim.pose import ORIGIN, Pose
from mbot_workstation.sim.scene.room_generator import generate_room
from mbot_workstation.sim.simulation import Simulation

from .scene_geometry import cube_corners, project

ROOM = generate_room(seed=0, width_px=64)
SIZE = (640, 480)


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    return Simulation(room_picture=ROOM)


@pytest.fixture(scope="module")
def camera(simulation: Simulation) -> Iterator[CameraRenderer]:
    with CameraRenderer(simulation, 320, 240) as renderer:
        yield renderer


def reddish(picture: Picture) -> np.ndarray:
    red, green, blue = np.moveaxis(picture.astype(int), -1, 0)
    return (red > 90) & (red > 2 * green) & (red > 2 * blue)


def red_box(picture: Picture) -> tuple[float, float, float, float]:
    """Left, top, right, bottom edges of what is red, as positions in the picture."""
    rows, columns = np.nonzero(reddish(picture))
    return columns.min() - 0.5, rows.min() - 0.5, columns.max() + 0.5, rows.max() + 0.5


@pytest.mark.parametrize(("y_m", "half"), [(0.15, "left"), (-0.15, "right")])
def test_a_cube_on_the_left_is_in_the_left_half(
    simulation: Simulation, camera: CameraRenderer, y_m: float, half: str
) -> None:
    simulation.place_robot(ORIGIN)
    simulation.place_object(Pose(0.7, y_m))
    left, _, right, _ = red_box(camera.picture(simulation.snapshot()))
    assert (right < 160) == (half == "left")
    assert (left > 160) == (half == "right")


def test_turning_left_moves_things_to_the_right(
    simulation: Simulation, camera: CameraRenderer
) -> None:
    simulation.place_object(Pose(1, 0))
    places = []
    for yaw in (0.0, 0.2):
        simulation.place_robot(Pose(0, 0, yaw))
        places.append(red_box(camera.picture(simulation.snapshot()))[0])
    assert places[1] > places[0] + 20


def test_the_cube_is_red_in_rgb_and_matte(simulation: Simulation, camera: CameraRenderer) -> None:
    simulation.place_robot(ORIGIN)
    simulation.place_object(Pose(0.4, 0))
    picture = camera.picture(simulation.snapshot())
    red, green, blue = picture[reddish(picture)].mean(axis=0)
    assert 120 < red < 205
    assert green / red == pytest.approx(30 / 200, abs=0.03)
    assert blue / red == pytest.approx(35 / 200, abs=0.03)


CAMERAS = {
    "nominal": nominal_pi_camera(*SIZE),
    "off centre": replace(nominal_pi_camera(*SIZE), principal_x_px=331.0, principal_y_px=230.0),
    "pixels not square": CameraModel(640, 480, 611.0, 500.0, 319.5, 239.5),
    "barrel": replace(nominal_pi_camera(*SIZE), distortion=(-0.1, 0.02, 0.0, 0.0, 0.0)),
    "pincushion": replace(nominal_pi_camera(*SIZE), distortion=(0.08, 0.0, 0.0, 0.0, 0.0)),
}


@pytest.mark.parametrize("name", list(CAMERAS))
def test_the_cube_appears_where_its_corners_are_projected(name: str) -> None:
    model = CAMERAS[name]
    mount = CameraMount(height_m=0.08, ahead_m=0.05, left_m=0.004, pitch_down_deg=6)
    robot = RobotParameters(camera=model, camera_mount=mount)
    simulation = Simulation(robot, room_picture=ROOM)
    with CameraRenderer(simulation, *SIZE) as renderer:
        for pose in (ORIGIN, Pose(-0.2, 0.3, -0.4)):
            simulation.place_robot(pose)
            for cube in (Pose(0.5, 0.12, 0.3), Pose(0.6, -0.15, 0.9), Pose(1.5, 0.1, -0.5)):
                corners = project(cube_corners(cube, 0.1), pose, mount, model)
                low, high = corners.min(axis=0), corners.max(axis=0)
                if (low < 2).any() or (high > np.array(SIZE) - 3).any():
                    continue
                simulation.place_object(cube)
                box = red_box(renderer.picture(simulation.snapshot()))
                assert np.allclose(box, (*low, *high), atol=1.0), cube


def test_every_size_shows_the_same_view(simulation: Simulation) -> None:
    simulation.place_robot(ORIGIN)
    simulation.place_object(Pose(0.5, 0.1, 0.3))
    boxes = []
    for width, height in ((640, 480), (64, 64)):
        with CameraRenderer(simulation, width, height) as renderer:
            box = red_box(renderer.picture(simulation.snapshot()))
        boxes.append(
            [(edge + 0.5) / size for edge, size in zip(box, (width, height) * 2, strict=True)]
        )
    assert np.allclose(boxes[0], boxes[1], atol=1 / 64)


def coloured_room() -> Picture:
    """Ahead and a little to the right is green, to the left blue; behind is white."""
    room = np.full((128, 256, 3), 255, np.uint8)
    room[:, 128:192] = (20, 200, 20)
    room[:, 64:128] = (20, 20, 200)
    return room


def test_the_panorama_is_not_mirrored_and_can_be_turned() -> None:
    simulation = Simulation(room_picture=coloured_room())
    simulation.place_object(Pose(-2, 0))
    with CameraRenderer(simulation, 320, 240) as renderer:
        top = renderer.picture(simulation.snapshot())[5]
        assert tuple(top[20]) == (20, 20, 200)
        assert tuple(top[-20]) == (20, 200, 20)
        simulation.turn_room(np.pi / 4)  # to the left: the green middle comes into view
        assert tuple(renderer.picture(simulation.snapshot())[5, 20]) == (20, 200, 20)
        simulation.turn_room(np.pi)
        assert tuple(renderer.picture(simulation.snapshot())[5, 160]) == (255, 255, 255)


def test_the_room_grows_as_the_robot_approaches_it() -> None:
    simulation = Simulation(room_picture=coloured_room())
    simulation.place_object(Pose(-2, 0))
    simulation.turn_room(-np.pi / 20)
    edges = []
    with CameraRenderer(simulation, 320, 240) as renderer:
        for x in (0.0, 2.0):
            simulation.place_robot(Pose(x, 0, 0))
            top = renderer.picture(simulation.snapshot())[5].astype(int)
            edges.append(np.argmax(top[:, 1] > 100))
    assert 160 < edges[0] < edges[1] - 10


def test_the_shadow_is_drawn_in_show_quality_only(simulation: Simulation) -> None:
    simulation.place_robot(ORIGIN)
    floor = {}
    for quality in (TRAINING, SHOW):
        with CameraRenderer(simulation, 160, 120, quality) as renderer:
            simulation.place_object(Pose(-2, 0))
            empty = renderer.picture(simulation.snapshot()).astype(int)
            simulation.place_object(Pose(0.5, 0.0))
            full = renderer.picture(simulation.snapshot()).astype(int)
        grey = np.ptp(full, axis=-1) < 40
        floor[quality] = ((empty - full).min(axis=-1) > 15) & grey
    assert floor[SHOW].sum() > 50
    assert floor[TRAINING].sum() < floor[SHOW].sum() / 5


def test_no_two_noisy_pictures_are_the_same_but_a_seed_repeats_them(
    simulation: Simulation,
) -> None:
    runs = []
    for _ in range(2):
        with CameraRenderer(
            simulation, 320, 240, isp=IspSettings(noise=1.0), noise_seed=4
        ) as renderer:
            runs.append([renderer.picture(simulation.snapshot()) for _ in range(2)])
    assert not np.array_equal(runs[0][0], runs[0][1])
    assert np.array_equal(runs[0][0], runs[1][0])
    difference = cv2.absdiff(runs[0][0], runs[0][1])
    assert 0.5 < difference.mean() < 4


def test_a_turn_blurs_and_shears_as_the_mean_of_many_moments_would(simulation: Simulation) -> None:
    turn_rad_s, exposure_s = 2.0, 0.020
    simulation.place_object(Pose(0.6, 0))
    with CameraRenderer(simulation, *SIZE) as sharp:
        moments = []
        for share in np.linspace(-0.5, 0.5, 9):
            simulation.place_robot(Pose(0, 0, turn_rad_s * exposure_s * share))
            moments.append(sharp.picture(simulation.snapshot()).astype(float))
        simulation.place_robot(ORIGIN)
        still = sharp.picture(simulation.snapshot()).astype(float)
    truth = np.mean(moments, axis=0)
    with CameraRenderer(simulation, *SIZE, shutter=Shutter(exposure_s, 0.0)) as camera:
        state = simulation.snapshot()
        blurred = camera.picture(state, turn_rad_s).astype(float)
        assert np.abs(camera.picture(state).astype(float) - still).mean() < 1.0
    assert np.abs(blurred - truth).mean() < np.abs(still - truth).mean() / 2
    with CameraRenderer(simulation, *SIZE, shutter=Shutter(0.0, 0.023)) as camera:
        sheared = camera.picture(state, turn_rad_s)
    middle = [red_box(picture)[0] for picture in (sheared, still.astype(np.uint8))]
    assert abs(middle[0] - middle[1]) < 6
    assert (sheared != still.astype(np.uint8)).mean() > 0.05


def test_a_closed_renderer_says_so(simulation: Simulation) -> None:
    renderer = CameraRenderer(simulation, 32, 32)
    renderer.close()
    renderer.close()
    with pytest.raises(RuntimeError, match="closed"):
        renderer.picture(simulation.snapshot())
