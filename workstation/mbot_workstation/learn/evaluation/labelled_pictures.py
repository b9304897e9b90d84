"""What policies do with labelled pictures: turn the right way, go ahead, are not fooled.

A folder with pictures and `truth.csv`, whose columns `file`, `in_view` (0 or 1) and
`bearing_left_deg` (left positive; empty where the object is not in view) count. Three more may be
there and are counted by: `distance_m` of the object; `distractor`, what has the object's colour and
is none, names joined by +, `furniture` being the room's own, with `plain`, what has another colour.
Single pictures tell nothing about driving, but they may be real photographs. `view_horizontal_deg`
and `view_vertical_deg`: it is no camera's picture but what a policy saw, and shows so much.
"""

import csv
import io
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mbot_protocol.drive.camera_model import CameraModel, nominal_pi_camera
from mbot_protocol.drive.picture import Observer, Picture
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.files.text_file import read_text
from mbot_protocol.policy.policy_contract import OBSERVATION_SIDE_PX, FieldOfView
from mbot_workstation.pictures.picture_file import read_picture

TRUTH_FILE = "truth.csv"
COLUMNS = ("file", "in_view", "bearing_left_deg")
VIEW_COLUMNS = ("view_horizontal_deg", "view_vertical_deg")

OFF_AXIS_DEG = 6.0
"""From here on an object is to one side; an observation's pixel is 0.9 degrees wide."""

ON_AXIS_DEG = 5.0
"""Up to here it is ahead."""

NEAR_M = 0.45
"""Wrong turns at nearer objects are counted by themselves too: they lose it."""

FAST = 0.5
"""Both wheels beyond this share of full speed: driving on, not searching."""

KINDS = {
    "wrong_way": "turned the wrong way",
    "wrong_way_near": f"wrong way nearer than {NEAR_M:g} m",
    "not_ahead": "did not go ahead",
    "fooled": "drove on at nothing",
    "fooled_bare_floor": "drove on: bare floor",
    "fooled_other_colour": "drove on: a thing of another colour",
    "fooled_same_colour": "drove on: a thing of its colour",
    "fooled_furniture": "drove on: furniture of its colour",
}
"""Mistakes that are counted: turned away from an object 6 degrees or more off the axis, or not at
all; did not go ahead, forward more than turning, at one within 5 degrees; drove on, both wheels
beyond half speed, where there is none. What a folder's columns tell nothing of is left out."""

PLAIN_KINDS = ("wrong_way", "not_ahead", "fooled")
"""What every folder tells."""


@dataclass(frozen=True, slots=True, eq=False)
class LabelledPicture:
    """One picture and what is on it.

    Attributes:
        name: of the file.
        picture: shape (h, w, 3), RGB.
        bearing_left_deg: of the object, left positive; None where there is none in view.
        kinds: of `KINDS`, which mistakes it can show.
        seen: what it shows, if it is what a policy saw; None: it is a camera's picture.

    """

    name: str
    picture: Picture
    bearing_left_deg: float | None
    kinds: tuple[str, ...]
    seen: FieldOfView | None = None


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


PictureScore = dict[str, Share]
"""What a policy made of labelled pictures, by `KINDS`."""


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


def judge(actions: NDArray[np.float32], pictures: Sequence[LabelledPicture]) -> PictureScore:
    """Count what a policy's actions, shape (n, 2), do about the objects on n pictures."""
    score: PictureScore = {}
    for kind in KINDS:
        able = [number for number, one in enumerate(pictures) if kind in one.kinds]
        wrong = [pictures[n].name for n in able if _is_mistaken(kind, actions[n], pictures[n])]
        if able or kind in PLAIN_KINDS:
            score[kind] = Share(tuple(wrong), len(able))
    return score


def _is_mistaken(kind: str, action: NDArray[np.float32], picture: LabelledPicture) -> bool:
    left, right = action.tolist()
    forward, turn_left = (left + right) / 2, (right - left) / 2
    if picture.bearing_left_deg is None:
        return min(left, right) > FAST
    if kind == "not_ahead":
        return forward <= abs(turn_left)
    return turn_left * picture.bearing_left_deg <= 0


def observations(
    pictures: Sequence[LabelledPicture], camera: CameraModel | None, view: FieldOfView
) -> NDArray[np.uint8]:
    """What the robot would show a policy of them. Shape (n, 64, 64, 3), RGB.

    Args:
        pictures: of any size.
        camera: calibrated; None is the nominal Pi camera.
        view: the policy's field of view.

    """
    observers: dict[tuple[int, int, FieldOfView | None], Observer] = {}
    made: list[Picture] = []
    for labelled in pictures:
        height_px, width_px, _ = labelled.picture.shape
        size, seen = (width_px, height_px), labelled.seen
        if seen == view and size == (OBSERVATION_SIDE_PX, OBSERVATION_SIDE_PX):
            made.append(labelled.picture)
            continue
        if (*size, seen) not in observers:
            if seen is not None:
                degrees = seen.horizontal_deg, seen.vertical_deg
                model = CameraModel.from_field_of_view(*size, *degrees)
            else:
                model = nominal_pi_camera(*size) if camera is None else camera.scaled_to(*size)
            observers[*size, seen] = Observer(model, view)
        made.append(observers[*size, seen].observe(labelled.picture))
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
        distance_m = float(row.get("distance_m") or "inf")
        if not distance_m > 0:
            raise ValueError
        shown = [float(row[name]) for name in VIEW_COLUMNS if row.get(name)]
        seen = FieldOfView(*shown) if len(shown) == len(VIEW_COLUMNS) else None
    except ValueError:
        raise ConfigurationError(
            f"{path}, line {line}: in_view is {row['in_view']!r}, bearing_left_deg "
            f"{row['bearing_left_deg']!r}, distance_m {row.get('distance_m', '')!r}; expected 0 or "
            "1, degrees, metres or nothing, and a field of view of 1 to 170 degrees or none"
        ) from None
    kinds = tuple(_kinds(row, bearing, distance_m))
    return LabelledPicture(row["file"], picture, bearing, kinds, seen)


def _kinds(row: dict[str, str], bearing_deg: float | None, distance_m: float) -> Iterator[str]:
    """Which mistakes a picture can show; between 5 and 6 degrees none."""
    if bearing_deg is not None:
        if abs(bearing_deg) >= OFF_AXIS_DEG:
            yield "wrong_way"
            if distance_m < NEAR_M:
                yield "wrong_way_near"
        elif abs(bearing_deg) <= ON_AXIS_DEG:
            yield "not_ahead"
        return
    yield "fooled"
    if "distractor" in row and "plain" in row:
        things = {name.strip() for name in row["distractor"].split("+")} - {""}
        if things - {"furniture"}:
            yield "fooled_same_colour"
        elif things:
            yield "fooled_furniture"
        else:
            yield "fooled_other_colour" if row["plain"].strip() else "fooled_bare_floor"
