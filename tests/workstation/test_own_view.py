"""A robot whose camera sees a part of itself sees it in training too."""

from dataclasses import replace

import numpy as np
import pytest

from mbot_protocol.drive.camera_model import CameraModel
from mbot_protocol.drive.picture import Picture
from mbot_protocol.policy.policy_contract import FULL_VIEW
from mbot_workstation.learn.worlds.task_env import TaskEnv
from mbot_workstation.sim.body.own_view import MARGIN_DEG, parts_in_view
from mbot_workstation.sim.body.robot_parameters import BoxBody, CameraMount, RobotParameters
from mbot_workstation.sim.camera.camera_renderer import CameraRenderer
from mbot_workstation.sim.simulation import Simulation

from .small_world import ROOMS

PLATE = BoxBody("plate", 0.3, (0.16, 0.08, 0.02), (0.02, 0.0, 0.05), (0.1, 1.0, 0.1))
IDEAL = CameraModel.from_field_of_view(128, 128, FULL_VIEW.horizontal_deg, FULL_VIEW.vertical_deg)


def robot(mount: CameraMount, plate: BoxBody = PLATE) -> RobotParameters:
    return RobotParameters(bodies=(plate,), camera=IDEAL, camera_mount=mount)


def green(picture: Picture) -> int:
    """How many pixels are."""
    red, middle, blue = np.moveaxis(picture.astype(int), -1, 0)
    return int(((middle > 60) & (middle > 2 * red) & (middle > 2 * blue)).sum())


def drawn(made: RobotParameters) -> int:
    simulation = Simulation(made, room_picture=ROOMS[0])
    with CameraRenderer(simulation, 128, 128) as renderer:
        return green(renderer.picture(simulation.snapshot()))


MOUNTS = [
    CameraMount(height_m, ahead_m, left_m, pitch_deg, yaw_deg, roll_deg)
    for height_m, ahead_m, left_m, pitch_deg, yaw_deg, roll_deg in (
        (0.075, 0.06, 0.0, 5.0, 0.0, 0.0),
        (0.075, 0.06, 0.0, -25.0, 0.0, 0.0),
        (0.10, 0.0, 0.0, 12.0, 0.0, 0.0),
        (0.09, 0.02, 0.06, 0.0, -40.0, 0.0),
        (0.09, 0.02, 0.06, 20.0, 60.0, 0.0),
        (0.08, 0.06, 0.0, 0.0, 0.0, 80.0),
        (0.12, 0.095, 0.0, 15.0, 0.0, 20.0),
        (0.05, -0.15, 0.0, 0.0, 0.0, 0.0),
        (0.055, 0.05, 0.0, 0.0, 0.0, 0.0),
    )
]


@pytest.mark.parametrize("mount", MOUNTS, ids=str)
def test_what_is_drawn_is_in_view(mount: CameraMount) -> None:
    made = robot(mount)
    pixels = drawn(made)
    wide = parts_in_view(made, FULL_VIEW.horizontal_deg, FULL_VIEW.vertical_deg)
    narrow = parts_in_view(
        made,
        FULL_VIEW.horizontal_deg - 2 * MARGIN_DEG - 2,
        FULL_VIEW.vertical_deg - 2 * MARGIN_DEG - 2,
    )
    if pixels:
        assert wide == ["plate"]
    if narrow:
        assert pixels > 0


def test_the_nominal_robot_does_not_see_itself() -> None:
    assert parts_in_view(RobotParameters(), FULL_VIEW.horizontal_deg, FULL_VIEW.vertical_deg) == []


def test_training_shows_what_the_camera_sees_of_its_own_robot() -> None:
    counts = []
    for mount in (CameraMount(), CameraMount(height_m=0.12)):
        environment = TaskEnv("ideal", "10", ROOMS, robot(mount))
        counts.append(green(environment.reset(seed=0)[0]))
        environment.close()
    assert counts[0] > 20
    assert counts[1] == 0


def test_the_box_the_lens_is_in_is_not_in_view() -> None:
    around = replace(PLATE, size_m=(0.04, 0.04, 0.04), centre_m=(0.06, 0.0, 0.075))
    made = robot(CameraMount(), around)
    assert drawn(made) == 0
    assert parts_in_view(made, FULL_VIEW.horizontal_deg, FULL_VIEW.vertical_deg) == []
