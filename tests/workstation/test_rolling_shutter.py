import cv2
import numpy as np
import pytest
from msgspec.structs import replace

from mbot_protocol.drive.camera_model import CameraModel
from mbot_protocol.drive.picture import Picture
from mbot_workstation.learn.worlds.robot_eye import OBSERVATION
from mbot_workstation.sim.body.robot_mjcf import ROBOT_CAMERA
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.camera.lens_distortion import LensDistortion
from mbot_workstation.sim.camera.rolling_shutter import RollingShutter
from mbot_workstation.sim.camera.scene_renderer import SceneRenderer
from mbot_workstation.sim.effects.effects import IDEAL
from mbot_workstation.sim.effects.perturbed_robot import observing_camera
from mbot_workstation.sim.pose import Pose
from mbot_workstation.sim.scene.room_generator import generate_room
from mbot_workstation.sim.simulation import Simulation

ROOM = generate_room(seed=0, width_px=512)
CAMERA = observing_camera(IDEAL)
PITCH_DEG = RobotParameters().camera_mount.pitch_down_deg
EXPOSURE_S, READOUT_S = 0.020, 0.023
DISTORTED = replace(CAMERA, distortion=(-0.1, 0.03, 0.0, 0.0, 0.0))


def shutter(camera: CameraModel, exposure_s: float, readout_s: float) -> RollingShutter:
    return RollingShutter(camera, exposure_s, readout_s, np.radians(PITCH_DEG))


def seen(through: RollingShutter, turn_rate_rad_s: float, yaw_rad: float = 0.0) -> Picture:
    view = through.view(turn_rate_rad_s)
    return through.expose(draw(view, [yaw_rad])[0], view, turn_rate_rad_s)


def draw(camera: CameraModel, yaws_rad: list[float]) -> list[Picture]:
    """What a robot in the origin sees when it heads there."""
    simulation = Simulation(RobotParameters(camera=camera), room_picture=ROOM)
    simulation.place_object(Pose(0.5, 0.16, 0.3))
    size = (camera.width_px, camera.height_px)
    with SceneRenderer(simulation, ROBOT_CAMERA, *size, OBSERVATION) as renderer:
        pictures = []
        for yaw_rad in yaws_rad:
            simulation.place_robot(Pose(0, 0, yaw_rad))
            pictures.append(renderer.draw(simulation.snapshot()))
        return pictures


def really_exposed(turn_rate_rad_s: float) -> np.ndarray:
    """Drawn moment by moment: every row the mean of those in its own exposure."""
    moments_s = np.linspace(-1, 1, 31) * (EXPOSURE_S + READOUT_S) / 2
    drawn = np.array(draw(CAMERA, list(moments_s * turn_rate_rad_s)), np.float64)
    middle_s = ((np.arange(64) + 0.5) / 64 - 0.5) * READOUT_S
    is_open = np.abs(moments_s[None] - middle_s[:, None]) <= EXPOSURE_S / 2
    return np.einsum("rm,mrxc->rxc", is_open / is_open.sum(1, keepdims=True), drawn)


def rms(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.sqrt(np.mean((one.astype(float) - other) ** 2)))


@pytest.mark.parametrize("turn_rate_rad_s", [0.0, 6.0])
def test_an_ideal_camera_is_drawn_as_it_is(turn_rate_rad_s: float) -> None:
    ideal = shutter(CAMERA, 0, 0)
    assert ideal.view(turn_rate_rad_s) == CAMERA
    assert np.array_equal(seen(ideal, turn_rate_rad_s), draw(CAMERA, [0.0])[0])


def test_a_camera_at_rest_sees_what_one_without_a_shutter_sees() -> None:
    assert np.array_equal(seen(shutter(CAMERA, EXPOSURE_S, READOUT_S), 0.1), draw(CAMERA, [0.0])[0])


@pytest.mark.parametrize("turn_rate_rad_s", [-6.0, -2.5, 1.5, 6.0])
def test_a_turn_looks_as_if_drawn_moment_by_moment(turn_rate_rad_s: float) -> None:
    turning = shutter(CAMERA, EXPOSURE_S, READOUT_S)
    truth = really_exposed(turn_rate_rad_s)
    error = rms(seen(turning, turn_rate_rad_s), truth)
    assert error < 4.0
    assert error < 0.5 * rms(seen(turning, 0.0), truth)
    assert error < 0.4 * rms(seen(turning, -turn_rate_rad_s), truth)


def test_a_lens_distorts_as_lens_distortion_does() -> None:
    lens = LensDistortion(DISTORTED, 320, 320)
    fine = lens.apply(draw(lens.drawn, [0.1])[0])
    truth = cv2.resize(fine, (64, 64), interpolation=cv2.INTER_AREA)
    error = rms(seen(shutter(DISTORTED, 0, 0), 0.0, 0.1), truth)
    assert error < 0.6 * rms(draw(CAMERA, [0.1])[0], truth)


@pytest.mark.parametrize("camera", [CAMERA, DISTORTED], ids=["straight", "barrel"])
@pytest.mark.parametrize("turn_rate_rad_s", [1.0, 7.0])
def test_the_view_holds_every_ray_the_camera_takes(
    camera: CameraModel, turn_rate_rad_s: float
) -> None:
    exposing = shutter(camera, 0.0, READOUT_S)
    view = exposing.view(turn_rate_rad_s)
    numbered = np.broadcast_to(np.arange(1, 65, dtype=np.uint8)[:, None], (64, 64, 3))
    beyond = np.pad(numbered[1:-1, 1:-1], ((1, 1), (1, 1), (0, 0)))  # 0 along the edges
    taken = exposing.expose(np.ascontiguousarray(beyond), view, turn_rate_rad_s)
    assert taken[2:-2, 2:-2].min() > 0
    assert exposing.view(-turn_rate_rad_s) == view
