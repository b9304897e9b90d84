"""The three pictures that the paper explains its policy with, rendered by the simulation."""

import math

from mbot_protocol.picture import Picture
from mbot_protocol.policy_contract import OBSERVATION_SIDE_PX
from mbot_workstation.simulation.camera_renderer import CameraRenderer
from mbot_workstation.simulation.pose import ORIGIN, Pose
from mbot_workstation.simulation.simulation import Simulation

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
