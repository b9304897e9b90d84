"""Objects to fetch as one picture: from four sides, and as a robot sees them."""

import math
from collections.abc import Sequence

import numpy as np

from mbot_protocol.drive.picture import Picture
from mbot_protocol.policy.policy_contract import OBSERVATION_SIDE_PX
from mbot_workstation.learn.worlds.robot_eye import OBSERVATION
from mbot_workstation.pictures.film_tile import GAP_PX, INK, TITLE_PX, blank, write
from mbot_workstation.sim.camera.camera_renderer import CameraRenderer
from mbot_workstation.sim.camera.scene_renderer import SHOW
from mbot_workstation.sim.pose import Pose
from mbot_workstation.sim.scene.scene_parameters import SceneParameters
from mbot_workstation.sim.scene.target_object import TargetObject
from mbot_workstation.sim.simulation import Simulation

SIDES_DEG = (0, 90, 180, 270)
"""How far the object is turned to the left."""

DISTANCES_M = (0.3, 1.0, 2.0)
"""Between camera and object's middle, along the floor: at hand, near, far."""

TURNED_DEG = 30
"""There it shows two sides."""

WIDTH_PX, HEIGHT_PX = 256, 192
LINE_PX = 20


def object_preview(kinds: Sequence[TargetObject]) -> Picture:
    """Two rows a kind, in the nominal room: its four sides; what a policy sees, 64 x 64 enlarged.

    Returns:
        Shape (h, w, 3), RGB.

    """
    simulation = Simulation(scene=SceneParameters(objects=tuple(kinds)))
    side = OBSERVATION_SIDE_PX
    with CameraRenderer(simulation, WIDTH_PX, HEIGHT_PX, SHOW) as camera:
        sides = [_sides(simulation, camera, number) for number in range(len(kinds))]
    with CameraRenderer(simulation, side, side, OBSERVATION) as camera:
        seen = [_seen(simulation, camera, number) for number in range(len(kinds))]
    rows: list[Picture] = []
    for thing, *pair in zip(kinds, sides, seen, strict=True):
        title = blank(TITLE_PX, pair[0].shape[1])
        size = f"{1000 * thing.width_m:.0f} mm wide, {1000 * thing.height_m:.0f} mm high"
        words = f"{thing.name}: {thing.shape.value}, {size}".encode("ascii", "replace").decode()
        write(title, words, (GAP_PX, 26), INK, 0.5)
        rows += [title, *pair]
    return np.vstack(rows)


def _sides(simulation: Simulation, camera: CameraRenderer, number: int) -> Picture:
    thing = simulation.scene.objects[number]
    away_m = max(0.2, 2.5 * max(thing.width_m, thing.height_m))  # fills half of the picture
    row: list[Picture] = []
    for turned_deg in SIDES_DEG:
        picture = _picture(simulation, camera, number, away_m, turned_deg)
        row += _tile(picture, f"turned by {turned_deg} degrees")
    return np.hstack(row)


def _seen(simulation: Simulation, camera: CameraRenderer, number: int) -> Picture:
    times = WIDTH_PX // OBSERVATION_SIDE_PX
    row: list[Picture] = []
    for away_m in DISTANCES_M:
        picture = _picture(simulation, camera, number, away_m, TURNED_DEG)
        row += _tile(picture.repeat(times, axis=0).repeat(times, axis=1), f"from {away_m:g} m")
    row += _tile(blank(WIDTH_PX, WIDTH_PX), "")
    return np.hstack(row)


def _picture(
    simulation: Simulation, camera: CameraRenderer, number: int, away_m: float, turned_deg: float
) -> Picture:
    """Of this object, so far ahead of the camera."""
    ahead_m = simulation.robot.camera_mount.ahead_m + away_m
    simulation.place_object(Pose(ahead_m, 0.0, math.radians(turned_deg)), number)
    return camera.picture(simulation.snapshot())


def _tile(picture: Picture, words: str) -> list[Picture]:
    """The picture with words above it, and a gap to the next one."""
    line = blank(LINE_PX, picture.shape[1])
    write(line, words, (2, 14), INK, 0.4)
    made = np.vstack([line, picture])
    return [made, blank(made.shape[0], GAP_PX)]
