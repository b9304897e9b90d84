"""The same frame as the real camera took it and as the simulation draws it."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from mbot_protocol.camera_model import CameraModel
from mbot_protocol.picture import Observer, Picture
from mbot_protocol.policy_contract import FULL_VIEW
from mbot_workstation.calibration_files.calibration_folder import CalibrationFiles, room_pictures
from mbot_workstation.gap_report.simulated_view import Place, SimulatedView
from mbot_workstation.simulation.robot_parameters import RobotParameters
from mbot_workstation.simulation.room import load_room
from mbot_workstation.simulation.room_generator import generate_room
from mbot_workstation.simulation.scene_renderer import SHOW, TRAINING

LARGEST_WIDTH_PX = 640
"""Of a picture on the page."""


@dataclass(frozen=True, slots=True, eq=False)
class RealFrame:
    """A picture with the place it was taken from.

    Attributes:
        title: for the page.
        picture: shape (h, w, 3), RGB.
        place: see `Place`.
        is_observation: 64 x 64, as the daemon hands it to a policy; otherwise the camera's own.

    """

    title: str
    picture: Picture
    place: Place
    is_observation: bool


@dataclass(frozen=True, slots=True, eq=False)
class FramePair:
    """One frame three times; all of one shape."""

    title: str
    real: Picture
    calibrated: Picture
    nominal: Picture


def frame_pairs(frames: Sequence[RealFrame], files: CalibrationFiles) -> tuple[FramePair, ...]:
    """Draw each frame with the calibration and without, in the calibration's first room.

    Raises:
        ConfigurationError: the room's panorama is unusable.

    """
    if not frames:
        return ()
    rooms = room_pictures(Path(files.folder)) if files.folder else ()
    room = load_room(rooms[0]) if rooms else generate_room(seed=0)
    drawn = [_draw(frames, one, room) for one in (files, CalibrationFiles())]
    return tuple(
        FramePair(frame.title, frame.picture, calibrated, nominal)
        for frame, calibrated, nominal in zip(frames, *drawn, strict=True)
    )


def _draw(frames: Sequence[RealFrame], files: CalibrationFiles, room: Picture) -> Sequence[Picture]:
    camera = _daemons_camera()
    pictures: list[Picture] = []
    for frame in frames:
        height, width, _ = frame.picture.shape
        size = (camera.width_px, camera.height_px) if frame.is_observation else (width, height)
        # Manoeuvres need more floor than the arena has, so they are driven without its walls; and
        # a policy's pictures are drawn as in its training.
        walls, quality = (False, TRAINING) if frame.is_observation else (True, SHOW)
        with SimulatedView(files, room, size, walls=walls, quality=quality) as view:
            picture = view.picture(frame.place)
        observer = Observer(camera, FULL_VIEW) if frame.is_observation else None
        pictures.append(picture if observer is None else observer.observe(picture))
    return pictures


def _daemons_camera() -> CameraModel:
    """What the daemon takes the camera for: a recording is made before the calibration is."""
    return RobotParameters().camera
