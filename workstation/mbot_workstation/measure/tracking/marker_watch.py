"""Follows a marker through a video or a live camera."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from mbot_protocol.drive.camera_model import CameraModel
from mbot_protocol.drive.picture import Picture
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.measure.tracking.floor_plane import FloorPlane
from mbot_workstation.measure.tracking.marker_detection import Grey, MarkerDetector, to_grey
from mbot_workstation.measure.tracking.overhead_track import Sight
from mbot_workstation.pictures.video_source import VideoSource
from mbot_workstation.sim.track import Array

MIRROR_LOOKS = 60
"""In the first so many pictures without the marker its mirror image is looked for, too."""

FindFloor = Callable[[CameraModel, Grey, dict[int, Array]], FloorPlane | None]
"""Looks for the floor in a picture with these markers."""


@dataclass(slots=True)
class Watch:
    """What has been seen so far.

    Attributes:
        pictures: looked at.
        sights: of the marker.
        floor: once it has been found.
        camera: for pictures of this size; known with the first one.

    """

    pictures: int
    sights: list[Sight]
    floor: FloorPlane | None = None
    camera: CameraModel | None = None


def frames(source: VideoSource) -> Iterator[tuple[float, Picture]]:
    """Pictures with their times: of the file, or this machine's monotonic clock for a camera.

    Raises:
        UnreachableError: a camera has stopped delivering.

    """
    is_file = Path(source.source).is_file()
    while True:
        picture = source.read()
        if picture is None:
            return
        # OpenCV's position is that of the frame just read.
        yield (source.position_s if is_file else time.monotonic()), picture


def watch_marker(
    pictures: Iterator[tuple[float, Picture]],
    marker_id: int,
    camera_for: Callable[[int, int], CameraModel],
    find_floor: FindFloor | None,
) -> Iterator[Watch]:
    """Look at picture after picture; yields the same Watch after each.

    Args:
        pictures: with their times.
        marker_id: the robot's.
        camera_for: the camera's model for pictures of this width and height.
        find_floor: looks for the floor until it has been found; None: not needed.

    Raises:
        ConfigurationError: the pictures are mirrored.

    """
    detector = MarkerDetector()
    watch = Watch(0, [])
    missed = 0
    for time_s, picture in pictures:
        grey = to_grey(picture)
        if watch.camera is None:
            watch.camera = camera_for(grey.shape[1], grey.shape[0])
        watch.pictures += 1
        markers = detector.find(grey)
        if find_floor is not None and watch.floor is None:
            watch.floor = find_floor(watch.camera, grey, markers)
        if marker_id in markers:
            watch.sights.append(Sight(time_s, markers[marker_id]))
        elif not watch.sights and missed < MIRROR_LOOKS:
            missed += 1
            if marker_id in detector.find(np.asarray(cv2.flip(grey, 1), dtype=np.uint8)):
                raise ConfigurationError(
                    "the pictures are mirrored: switch off the camera's mirror or flip; a mirrored "
                    "track would turn the wrong way"
                )
        yield watch
