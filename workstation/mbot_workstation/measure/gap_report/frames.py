"""Real frames with the places they were taken from: a folder with frames.csv, or telemetry."""

import csv
import logging
import math
from collections.abc import Mapping
from pathlib import Path
from typing import cast

import cv2
import numpy as np

from mbot_protocol.beat.recorded_drive import read_drive
from mbot_protocol.drive.picture import Picture
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.files.text_file import read_text
from mbot_workstation.measure.gap_report.compare import ComparedRun
from mbot_workstation.measure.gap_report.simulated_view import FramePlace, RealFrame
from mbot_workstation.measure.tracks.recording_folder import TELEMETRY_FILE
from mbot_workstation.pictures.picture_file import observation, read_picture
from mbot_workstation.sim.pose import ORIGIN, Pose

_log = logging.getLogger(__name__)

FRAMES_FILE = "frames.csv"
ROBOT = ("x_m", "y_m", "yaw_deg")
CUBE = ("cube_x_m", "cube_y_m", "cube_yaw_deg")
COLUMNS = f"file,{','.join(ROBOT)} and, if there is an object, {','.join(CUBE)}"
FURTHEST_M = 20.0

LARGEST_WIDTH_PX = 640
"""Of a picture on the page."""

MOMENTS = (-1e-9, 0.35, 0.7)
"""Of the drive, as shares; the first is the last picture before it."""

NEAR_S = 0.5
"""Pictures are 0.4 s apart, a decision's period."""

STANDING_S = 1.5
"""Before the first command; any picture of it will do."""

OBSERVATION_SHAPE = (64, 64, 3)


def read_frames(folder: Path) -> tuple[RealFrame, ...]:
    """All pictures of a folder.

    frames.csv has the columns file, x_m, y_m, yaw_deg and, where the object is in the picture,
    cube_x_m, cube_y_m, cube_yaw_deg. Places count from where the panorama was taken, x towards its
    middle, y to the left.

    Raises:
        ConfigurationError: something is missing or unusable; with the line.

    """
    path = folder / FRAMES_FILE
    try:
        lines = read_text(path).splitlines()
    except ConfigurationError as error:
        raise ConfigurationError(f"{error}; expected the columns {COLUMNS}") from None
    reader = csv.DictReader(lines, skipinitialspace=True)
    names = reader.fieldnames or ()
    if not {"file", *ROBOT} <= set(names) <= {"file", *ROBOT, *CUBE}:
        raise ConfigurationError(f"{path} has the columns {','.join(names)!r}, expected {COLUMNS}")
    frames = [_frame(folder, f"{path}, line {reader.line_num}", row) for row in reader]
    if not frames:
        raise ConfigurationError(f"{path} names no picture")
    return tuple(frames)


def _frame(folder: Path, where: str, row: Mapping[str, str | None]) -> RealFrame:
    name = (row["file"] or "").strip()
    robot = _pose(where, row, ROBOT)
    cube = _pose(where, row, CUBE) if any((row.get(key) or "").strip() for key in CUBE) else None
    title = f"{name}: robot at {robot.x_m:g}, {robot.y_m:g} m, {math.degrees(robot.yaw_rad):g}°"
    try:
        picture = read_picture(folder / name, turn=True)
    except ConfigurationError as error:
        raise ConfigurationError(f"{where}: {error}") from None
    height, width = picture.shape[:2]
    if width > LARGEST_WIDTH_PX:
        size = LARGEST_WIDTH_PX, round(height * LARGEST_WIDTH_PX / width)
        picture = cast(Picture, cv2.resize(picture, size, interpolation=cv2.INTER_AREA))
    return RealFrame(title, picture, FramePlace(robot, cube), False)


def _pose(where: str, row: Mapping[str, str | None], names: tuple[str, str, str]) -> Pose:
    values: list[float] = []
    for name in names:
        text = (row.get(name) or "").strip()
        try:
            value = float(text)
        except ValueError:
            raise ConfigurationError(f"{where}: {name} is {text!r}, expected a number") from None
        limit = FURTHEST_M if name.endswith("_m") else 360.0
        if not abs(value) <= limit:
            raise ConfigurationError(f"{where}: {name} is {text}, expected at most {limit:g}")
        values.append(value)
    return Pose(values[0], values[1], math.radians(values[2]))


def telemetry_frames(folder: Path, first: ComparedRun, start_s: float) -> tuple[RealFrame, ...]:
    """Up to three pictures of a session's first run that the recording's telemetry holds.

    Only that run certainly began where everything else counts from: on the cross where the
    panorama was taken, facing its middle.

    Args:
        folder: the recording's.
        first: the session's first run.
        start_s: of its first command, on the robot's clock.

    Returns:
        None at all if there is no telemetry that can be read, or no pictures of that time.

    """
    path = folder / TELEMETRY_FILE
    if not path.exists():
        return ()
    seen = _pictures_between(path, start_s - STANDING_S, start_s + first.driven_s)
    frames: list[RealFrame] = []
    for share in MOMENTS:
        wanted_s = start_s + share * first.driven_s
        before = [moment_s for moment_s in seen if moment_s <= wanted_s]
        if not before or wanted_s - before[-1] > (STANDING_S if share < 0 else NEAR_S):
            continue
        since_s = before[-1] - start_s
        title, pose = "before it starts", ORIGIN
        if since_s > 0:
            title = f"{since_s:.1f} s into {first.maneuver}"
            pose = Pose(*(float(np.interp(since_s, first.time_s, c)) for c in first.measured.T))
        frames.append(RealFrame(title, seen[before[-1]], FramePlace(pose), is_observation=True))
    return tuple(frames)


def _pictures_between(path: Path, first_s: float, last_s: float) -> dict[float, Picture]:
    """Pictures by when they were taken, on the robot's clock, in order."""
    found: dict[float, Picture] = {}
    try:
        drive = read_drive(path)
    except ConfigurationError as error:
        _log.warning("%s", error)
        return found
    for words in drive.words:
        _log.warning("%s", words)
    for beat in drive.beats:
        moment_s = beat.decision.captured_monotonic_ns / 1e9
        if moment_s and first_s <= moment_s <= last_s:
            picture = observation(beat)
            if picture is not None and picture.shape == OBSERVATION_SHAPE:
                found[moment_s] = picture
    return dict(sorted(found.items()))
