"""The whole way from a video or a camera to a track file."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from mbot_protocol.drive.camera_model import CameraModel
from mbot_protocol.drive.picture import Picture
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.measure.targets.marker_detection import Grey, MarkerDetector, to_grey
from mbot_workstation.measure.tracking.floor_plane import (
    FloorPlane,
    plane_from_board,
    plane_from_corners,
)
from mbot_workstation.measure.tracking.overhead_track import (
    MarkerSight,
    OverheadTrack,
    overhead_track,
)
from mbot_workstation.measure.tracks.track import Array
from mbot_workstation.measure.tracks.track_file import write_tum
from mbot_workstation.pictures.video_source import VideoSource

MIRROR_LOOKS = 60
"""In the first so many pictures without the marker its mirror image is looked for, too."""

FindFloor = Callable[[CameraModel, Grey, dict[int, Array]], FloorPlane | None]
"""Looks for the floor in a picture with these markers."""


def floor_finder(corners_m: tuple[float, float] | None, board_mm: float | None) -> FindFloor | None:
    """What finds the floor by markers at a rectangle's corners, or by a board; None by neither."""
    if corners_m is not None:
        return lambda camera, _grey, markers: plane_from_corners(camera, markers, *corners_m)
    if board_mm is not None:
        return lambda camera, grey, _markers: plane_from_board(camera, grey, board_mm)
    return None


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
    sights: list[MarkerSight]
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
            watch.sights.append(MarkerSight(time_s, markers[marker_id]))
        elif not watch.sights and missed < MIRROR_LOOKS:
            missed += 1
            if marker_id in detector.find(np.asarray(cv2.flip(grey, 1), dtype=np.uint8)):
                raise ConfigurationError(
                    "the pictures are mirrored: switch off the camera's mirror or flip; a mirrored "
                    "track would turn the wrong way"
                )
        yield watch


SAVE_EVERY_S = 20.0
"""A live camera's track is worked out and written this often: so much can be lost."""


@dataclass(frozen=True, slots=True)
class MarkerSettings:
    """What is known beforehand.

    Attributes:
        marker_id: on the robot.
        edge_m: of its black square.
        height_m: of it above the floor.
        camera_for: the camera's model for pictures of a width and height.
        camera_is_known: whether that is calibrated.
        find_floor: looks for what lies on the floor; None: the marker itself tells.

    """

    marker_id: int
    edge_m: float
    height_m: float
    camera_for: Callable[[int, int], CameraModel]
    camera_is_known: bool
    find_floor: FindFloor | None = None


def track_marker(
    source: str,
    output: Path,
    settings: MarkerSettings,
    stop: threading.Event,
    report: Callable[[Watch], None] = lambda _watch: None,
) -> OverheadTrack:
    """Follow the marker until the film ends or `stop`, and write the track.

    Args:
        source: as `VideoSource` takes it.
        output: TUM file, written whole or not at all; of a live camera again and again.
        settings: see there.
        stop: ends it.
        report: hears of every picture.

    Raises:
        UnreachableError: the camera can't be opened or has stopped; what was seen is written.
        ConfigurationError: the pictures don't show what they should.

    """
    watch = Watch(0, [])
    is_live = not Path(source).is_file()
    saved_s = time.monotonic()
    with VideoSource(source) as video:
        looks = watch_marker(
            frames(video), settings.marker_id, settings.camera_for, settings.find_floor
        )
        try:
            for watch in looks:
                report(watch)
                if stop.is_set():
                    break
                if is_live and time.monotonic() - saved_s > SAVE_EVERY_S:
                    # Too little yet, or too little of the floor: the end will tell.
                    with suppress(ConfigurationError):
                        write_tum(output, _solve(watch, settings).track)
                    saved_s = time.monotonic()
        except Exception:
            with suppress(ConfigurationError):
                write_tum(output, _solve(watch, settings).track)
            raise
    result = _solve(watch, settings)
    write_tum(output, result.track)
    return result


def _solve(watch: Watch, settings: MarkerSettings) -> OverheadTrack:
    if watch.camera is None:
        raise ConfigurationError("there was no picture")
    if settings.find_floor is not None and watch.floor is None:
        raise ConfigurationError(
            f"what should lie on the floor is in none of the {watch.pictures} pictures; it must be "
            "whole in view until it has been found, which takes one picture"
        )
    return overhead_track(
        watch.sights,
        watch.camera,
        settings.edge_m,
        settings.height_m,
        camera_is_known=settings.camera_is_known,
        floor=watch.floor,
    )
