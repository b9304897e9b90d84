"""The three pictures that the paper explains its policy with, and a drive to check a policy by."""

import math

from mbot_protocol.drive.picture import Picture
from mbot_protocol.policy.policy_contract import OBSERVATION_SIDE_PX
from mbot_workstation.sim.camera.camera_renderer import CameraRenderer
from mbot_workstation.sim.pose import ORIGIN, Pose
from mbot_workstation.sim.simulation import Simulation

NO_OBJECT, OBJECT_LEFT, OBJECT_CENTRAL = "no object", "object left", "object central"

DISTANCE_M = 0.9
"""The cube is 7 pixels wide there: seen at a glance, and well inside the view."""
LEFT_DEG = 17.0

_BEARINGS_DEG = {NO_OBJECT: 180.0, OBJECT_LEFT: LEFT_DEG, OBJECT_CENTRAL: 0.0}


def example_frames(room_picture: Picture | None = None) -> dict[str, Picture]:
    """Observations of a robot that stands in the middle, by what is to be seen.

    Args:
        room_picture: the room; a made-up one when None. Shape (h, 2 h, 3).

    Returns:
        Three pictures of shape (64, 64, 3).

    """
    simulation = Simulation(room_picture=room_picture)
    simulation.place_robot(ORIGIN)
    side = OBSERVATION_SIDE_PX
    frames: dict[str, Picture] = {}
    with CameraRenderer(simulation, side, side) as camera:
        for name, bearing_deg in _BEARINGS_DEG.items():
            angle = math.radians(bearing_deg)
            place = Pose(DISTANCE_M * math.cos(angle), DISTANCE_M * math.sin(angle), 0.4)
            simulation.place_object(place)
            frames[name] = camera.picture(simulation.snapshot())
    return frames


DRIVES_DEG = (150.0, -110.0)
"""Where the object is at the beginning of each drive of the golden sequence."""
SEARCH_STEP_DEG = 15.0
APPROACH_STEP_M = 0.05
DRIVE_FRAMES = 40


def golden_sequence() -> list[tuple[Picture, bool]]:
    """80 observations of two drives, and whether each begins one.

    The robot turns on the spot until the object is ahead, and goes there. Nothing is drawn at
    random: a machine that renders alike makes the same pictures.
    """
    simulation = Simulation()
    side = OBSERVATION_SIDE_PX
    frames: list[tuple[Picture, bool]] = []
    with CameraRenderer(simulation, side, side) as camera:
        for bearing_deg in DRIVES_DEG:
            angle = math.radians(bearing_deg)
            away_m = 2 * DISTANCE_M
            simulation.place_object(Pose(away_m * math.cos(angle), away_m * math.sin(angle), 0.4))
            turns = math.floor(abs(bearing_deg) / SEARCH_STEP_DEG)
            for moment in range(DRIVE_FRAMES):
                turned = math.copysign(min(moment, turns) * SEARCH_STEP_DEG, bearing_deg)
                yaw, way_m = math.radians(turned), max(0, moment - turns) * APPROACH_STEP_M
                simulation.place_robot(Pose(way_m * math.cos(yaw), way_m * math.sin(yaw), yaw))
                frames.append((camera.picture(simulation.snapshot()), moment == 0))
    return frames
