"""Pictures with the places they were taken from: a folder with frames.csv."""

import csv
import math
from collections.abc import Mapping
from pathlib import Path
from typing import cast

import cv2
import numpy as np

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.picture import Picture
from mbot_workstation.gap_report.frame_pair import LARGEST_WIDTH_PX, RealFrame
from mbot_workstation.gap_report.simulated_view import Place
from mbot_workstation.simulation.pose import Pose

FRAMES_FILE = "frames.csv"
ROBOT = ("x_m", "y_m", "yaw_deg")
CUBE = ("cube_x_m", "cube_y_m", "cube_yaw_deg")
FURTHEST_M = 20.0


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
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is no text"
        raise ConfigurationError(
            f"can't read {path}: {reason}; expected the columns file,{','.join(ROBOT)} and, if "
            f"there is an object, {','.join(CUBE)}"
        ) from None
    reader = csv.DictReader(lines, skipinitialspace=True)
    known = {"file", *ROBOT, *CUBE}
    header = set(reader.fieldnames or ())
    if not {"file", *ROBOT} <= header <= known:
        raise ConfigurationError(
            f"{path} has the columns {','.join(reader.fieldnames or ())!r}, expected "
            f"file,{','.join(ROBOT)} and, if there is an object, {','.join(CUBE)}"
        )
    frames = [_frame(folder, f"{path}, line {reader.line_num}", row) for row in reader]
    if not frames:
        raise ConfigurationError(f"{path} names no picture")
    return tuple(frames)


def _frame(folder: Path, where: str, row: Mapping[str, str | None]) -> RealFrame:
    name = (row["file"] or "").strip()
    robot = _pose(where, row, ROBOT)
    assert robot is not None
    cube = _pose(where, row, CUBE) if any((row.get(key) or "").strip() for key in CUBE) else None
    title = f"{name}: robot at {robot.x_m:g}, {robot.y_m:g} m, {math.degrees(robot.yaw_rad):g}°"
    return RealFrame(title, _picture(folder / name, where), Place(robot, cube), False)


def _pose(where: str, row: Mapping[str, str | None], names: tuple[str, str, str]) -> Pose | None:
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


def _picture(path: Path, where: str) -> Picture:
    try:
        encoded = np.frombuffer(path.read_bytes(), np.uint8)
    except OSError as error:
        raise ConfigurationError(f"{where}: can't read {path}: {error.strerror}") from None
    decoded = cv2.imdecode(encoded, cv2.IMREAD_COLOR) if encoded.size else None
    if decoded is None:
        raise ConfigurationError(f"{where}: {path} is no picture OpenCV can decode")
    height, width = decoded.shape[:2]
    if width > LARGEST_WIDTH_PX:
        size = LARGEST_WIDTH_PX, round(height * LARGEST_WIDTH_PX / width)
        decoded = cv2.resize(decoded, size, interpolation=cv2.INTER_AREA)
    return cast(Picture, cv2.cvtColor(decoded, cv2.COLOR_BGR2RGB))
