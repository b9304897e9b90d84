"""What policies do with labelled pictures: turn the right way, go ahead, are not fooled.

A folder with pictures and `truth.csv`, whose columns `file`, `in_view` (0 or 1) and
`bearing_left_deg` (left positive; empty where the object is not in view) count; others may be
there. Single pictures tell nothing about driving, but they may be real photographs.
"""

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mbot_protocol.drive.camera_model import CameraModel, nominal_pi_camera
from mbot_protocol.drive.picture import Observer, Picture
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.files.text_file import read_text
from mbot_protocol.policy.policy_contract import FieldOfView
from mbot_workstation.pictures.picture_file import read_picture

TRUTH_FILE = "truth.csv"
COLUMNS = ("file", "in_view", "bearing_left_deg")

OFF_AXIS_DEG = 6.0
"""From here on an object is to one side; an observation's pixel is 0.9 degrees wide."""

ON_AXIS_DEG = 5.0
"""Up to here it is ahead."""

FAST = 0.5
"""Both wheels beyond this share of full speed: driving on, not searching."""


@dataclass(frozen=True, slots=True, eq=False)
class LabelledPicture:
    """One picture and what is on it.

    Attributes:
        name: of the file.
        picture: shape (h, w, 3), RGB.
        bearing_left_deg: of the object, left positive; None where there is none in view.

    """

    name: str
    picture: Picture
    bearing_left_deg: float | None


@dataclass(frozen=True, slots=True)
class Share:
    """So many of so many, with the names of those that count.

    Attributes:
        names: of the pictures that count.
        total: of how many.

    """

    names: tuple[str, ...]
    total: int

    @property
    def interval(self) -> tuple[float, float]:
        """Of 95 %, of the share (Wilson's score interval)."""
        if self.total == 0:
            return 0.0, 1.0
        n, share, z = self.total, len(self.names) / self.total, 1.96
        middle = (share + z * z / (2 * n)) / (1 + z * z / n)
        half = z / (1 + z * z / n) * math.sqrt(share * (1 - share) / n + z * z / (4 * n * n))
        return max(middle - half, 0.0), min(middle + half, 1.0)


@dataclass(frozen=True, slots=True)
class PictureScore:
    """What a policy made of labelled pictures.

    Attributes:
        wrong_way: turned away from an object 6 degrees or more off the axis, or not at all.
        not_ahead: did not go ahead, forward more than turning, at one within 5 degrees.
        fooled: drove on, both wheels beyond half speed, where there is none.

    """

    wrong_way: Share
    not_ahead: Share
    fooled: Share


def read_labelled(folder: Path) -> list[LabelledPicture]:
    """The pictures of a folder with their labels.

    Raises:
        ConfigurationError: there is no truth.csv, a column or a picture is missing or unusable.

    """
    path = folder / TRUTH_FILE
    try:
        text = read_text(path)
        rows = list(csv.DictReader(io.StringIO(text, newline=""), restval=""))
    except (ConfigurationError, csv.Error) as error:
        raise ConfigurationError(
            f"{error}; expected a table {path} with {', '.join(COLUMNS)}"
        ) from None
    if not rows or any(name not in rows[0] for name in COLUMNS):
        raise ConfigurationError(f"{path}: expected rows with the columns {', '.join(COLUMNS)}")
    return [_labelled(folder, row, path, number) for number, row in enumerate(rows, start=2)]


def judge(
    actions: NDArray[np.float32], bearings_left_deg: Sequence[float | None], names: Sequence[str]
) -> PictureScore:
    """Count what a policy's actions do about the objects.

    Args:
        actions: shape (n, 2), left and right wheel in [-1, 1].
        bearings_left_deg: of the n pictures' objects; None where none is in view.
        names: of the n pictures.

    """
    wrong: list[str] = []
    not_ahead: list[str] = []
    fooled: list[str] = []
    totals = [0, 0, 0]
    for (left, right), bearing, name in zip(
        actions.tolist(), bearings_left_deg, names, strict=True
    ):
        forward, turn_left = (left + right) / 2, (right - left) / 2
        if bearing is None:
            totals[2] += 1
            if min(left, right) > FAST:
                fooled.append(name)
        elif abs(bearing) >= OFF_AXIS_DEG:
            totals[0] += 1
            if turn_left * bearing <= 0:
                wrong.append(name)
        elif abs(bearing) <= ON_AXIS_DEG:
            totals[1] += 1
            if forward <= abs(turn_left):
                not_ahead.append(name)
    shares = zip((wrong, not_ahead, fooled), totals, strict=True)
    return PictureScore(*(Share(tuple(found), total) for found, total in shares))


def observations(
    pictures: Sequence[LabelledPicture], camera: CameraModel | None, view: FieldOfView
) -> NDArray[np.uint8]:
    """What the robot would show a policy of them. Shape (n, 64, 64, 3), RGB.

    Args:
        pictures: of any size.
        camera: calibrated; None is the nominal Pi camera.
        view: the policy's field of view.

    """
    observers: dict[tuple[int, int], Observer] = {}
    made: list[Picture] = []
    for labelled in pictures:
        height_px, width_px, _ = labelled.picture.shape
        size = (width_px, height_px)
        if size not in observers:
            model = nominal_pi_camera(*size) if camera is None else camera.scaled_to(*size)
            observers[size] = Observer(model, view)
        made.append(observers[size].observe(labelled.picture))
    return np.stack(made)


def _labelled(folder: Path, row: dict[str, str], path: Path, line: int) -> LabelledPicture:
    try:
        picture = read_picture(folder / row["file"], turn=True)
    except ConfigurationError as error:
        raise ConfigurationError(f"{path}, line {line}: {error}") from None
    try:
        bearing = float(row["bearing_left_deg"]) if int(row["in_view"]) else None
        if bearing is not None and not -180 <= bearing <= 180:
            raise ValueError
    except ValueError:
        raise ConfigurationError(
            f"{path}, line {line}: in_view is {row['in_view']!r} and bearing_left_deg "
            f"{row['bearing_left_deg']!r}, expected 0 or 1 and degrees"
        ) from None
    return LabelledPicture(row["file"], picture, bearing)
