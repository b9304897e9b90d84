"""What the simulated robot's camera sees from a place: with its calibration, and without."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mbot_protocol.drive.picture import Observer, Picture
from mbot_protocol.policy.policy_contract import FULL_VIEW
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.calibrated.calibration_folder import CalibrationFiles, room_pictures
from mbot_workstation.sim.camera.camera_renderer import CameraRenderer
from mbot_workstation.sim.camera.isp import IspSettings
from mbot_workstation.sim.camera.scene_renderer import SHOW, TRAINING, Quality
from mbot_workstation.sim.effects.isp_settings import isp_settings
from mbot_workstation.sim.pose import Pose
from mbot_workstation.sim.scene.room import load_room
from mbot_workstation.sim.scene.room_generator import generate_room
from mbot_workstation.sim.simulation import Simulation

NOWHERE = Pose(500.0, 0.0)
"""For a cube that is not there: a speck beyond the horizon."""

FREE_FLOOR_M = 100.0
"""For walls that are not there."""


@dataclass(frozen=True, slots=True)
class FramePlace:
    """Where robot and object are, in the arena: its origin is where the panorama was taken, and x
    points to the panorama's middle.
    """

    robot: Pose
    cube: Pose | None = None


@dataclass(frozen=True, slots=True, eq=False)
class RealFrame:
    """A picture, shape (h, w, 3), RGB, with the place it was taken from: the camera's own, or as an
    observation 64 x 64, as the daemon hands it to a policy.
    """

    title: str
    picture: Picture
    place: FramePlace
    is_observation: bool


@dataclass(frozen=True, slots=True, eq=False)
class FramePair:
    """One frame three times; all of one shape."""

    title: str
    real: Picture
    calibrated: Picture
    nominal: Picture

    def levels_off(self, drawn: Picture) -> float:
        """Mean absolute difference of all levels between the real picture and another, of 255."""
        return float(np.abs(self.real.astype(np.int16) - drawn.astype(np.int16)).mean())


@contextmanager
def simulated_view(
    files: CalibrationFiles,
    room: Picture,
    size: tuple[int, int],
    *,
    walls: bool = True,
    quality: Quality = SHOW,
) -> Iterator[Callable[[FramePlace], Picture]]:
    """Something that draws pictures, shape (height, width, 3), RGB; it holds an OpenGL context.

    Args:
        files: the robot; an empty one is nominal.
        room: the panorama.
        size: width and height of the pictures.
        walls: whether the arena has any.
        quality: of the drawing.

    """
    scene = files.scene
    if not walls:
        far = replace(scene.arena, wall_m=FREE_FLOOR_M, border_m=FREE_FLOOR_M)
        scene = replace(scene, arena=far)
    simulation = Simulation(files.robot, scene, room)
    isp = IspSettings(gains=isp_settings(files.effects).gains)
    with CameraRenderer(simulation, *size, quality, isp=isp) as renderer:

        def picture(place: FramePlace) -> Picture:
            simulation.place_object(place.cube or NOWHERE)
            simulation.place_robot(place.robot)
            simulation.step(0.2)  # the soft contacts take the weight
            return renderer.picture(simulation.snapshot())

        yield picture


def frame_pairs(frames: Sequence[RealFrame], files: CalibrationFiles) -> tuple[FramePair, ...]:
    """Draw each frame with the calibration and without, in the calibration's first room.

    Raises:
        ConfigurationError: the room's panorama is unusable.

    """
    if not frames:
        return ()
    rooms = room_pictures(Path(files.folder)) if files.folder else ()
    room = load_room(rooms[0]) if rooms else generate_room(seed=0)
    robots = files, CalibrationFiles()
    return tuple(
        FramePair(frame.title, frame.picture, *(_draw(frame, robot, room) for robot in robots))
        for frame in frames
    )


def _draw(frame: RealFrame, files: CalibrationFiles, room: Picture) -> Picture:
    if not frame.is_observation:
        height, width, _ = frame.picture.shape
        with simulated_view(files, room, (width, height)) as draw:
            return draw(frame.place)
    # A recording is made before the calibration is, so the daemon takes its camera for a nominal
    # one. Maneuvers need more floor than the arena has, so they are driven without its walls; and
    # a policy's pictures are drawn as in its training.
    camera = RobotParameters().camera
    size = camera.width_px, camera.height_px
    with simulated_view(files, room, size, walls=False, quality=TRAINING) as draw:
        return Observer(camera, FULL_VIEW).observe(draw(frame.place))
