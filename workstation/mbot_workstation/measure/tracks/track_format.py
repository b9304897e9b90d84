"""`track.toml`: how a tracker's file is to be read, since no two trackers agree."""

import tomllib
from pathlib import Path
from typing import Annotated, Literal

import msgspec
from msgspec import Meta, Struct

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.files.text_file import text_if_any

TRACK_FORMAT_FILE = "track.toml"

Column = Annotated[str, Meta(min_length=1)] | Annotated[int, Meta(ge=1)]
"""A column's name in the header, or its number from 1."""

TimeUnit = Literal["s", "ms", "us", "ns"]
LengthUnit = Literal["m", "cm", "mm", "inch", "foot"]
Up = Literal["x", "y", "z", "-x", "-y", "-z"]

SECONDS: dict[str, float] = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
METRES: dict[str, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001, "inch": 0.0254, "foot": 0.3048}


class TrackFormat(Struct, frozen=True, forbid_unknown_fields=True):
    """What the numbers in a track mean. The defaults are TUM's: time x y z qx qy qz qw.

    Attributes:
        time, position, quaternion, euler, rotation_vector: columns. A position of two is on the
            floor. Without a quaternion one to three Euler angles serve, or a rotation vector: the
            axis, as long as the angle. With several, the quaternion is taken.
        time_unit, position_unit: of the columns.
        frames_hz: where the column of time counts frames: so many a second.
        up: the axis of the tracker's frame that points up, "-y" if y points down.
        handedness: of the tracker's frame; Unity's and DirectX's are left-handed.
        quaternion_order: of the columns in `quaternion`.
        euler_axes: one letter a column: the axes turned about, in order, each about the axes as
            turned so far (intrinsic): "zyx" is yaw, pitch, roll in a frame with z up.
        euler_unit: of the angles, and of a rotation vector.
        topic: which topic of an MCAP file, where it holds poses on several.

    """

    time: Column = 1
    position: Annotated[tuple[Column, ...], Meta(min_length=2, max_length=3)] = (2, 3, 4)
    quaternion: tuple[Column, Column, Column, Column] | None = (5, 6, 7, 8)
    euler: tuple[Column, ...] | None = None
    rotation_vector: tuple[Column, Column, Column] | None = None
    time_unit: TimeUnit = "s"
    frames_hz: Annotated[float, Meta(gt=0)] | None = None
    position_unit: LengthUnit = "m"
    up: Up = "z"
    handedness: Literal["right", "left"] = "right"
    quaternion_order: Literal["w-first", "w-last"] = "w-last"
    euler_axes: Annotated[str, Meta(pattern="^[xyz]{1,3}$")] = "zyx"
    euler_unit: Literal["deg", "rad"] = "deg"
    topic: str | None = None

    def __post_init__(self) -> None:
        if len(self.position) == 2 and self.up not in ("z", "-z"):
            raise ValueError(
                f"position has two columns, so they are on the floor and up is z, not {self.up}"
            )
        if self.quaternion is None and self.rotation_vector is None:
            if self.euler is None:
                raise ValueError("neither `quaternion` nor `euler` names columns: one must")
            if len(self.euler) != len(self.euler_axes):
                raise ValueError(
                    f"euler has {len(self.euler)} columns, euler_axes {self.euler_axes!r} has "
                    f"{len(self.euler_axes)} letters; they belong together"
                )


PRESETS: dict[str, TrackFormat] = {
    "tum": TrackFormat(),
    # What the triad_openvr scripts write. Their two pitch formulas disagree, so: the quaternion.
    "triad-openvr": TrackFormat(
        time="time",
        position=("x", "y", "z"),
        quaternion=("r_w", "r_x", "r_y", "r_z"),
        quaternion_order="w-first",
        up="y",
    ),
}


def read_track_format(folder: Path) -> TrackFormat | None:
    """The folder's track.toml; None if there is none.

    Raises:
        ConfigurationError: it is unusable; with the key.

    """
    path = folder / TRACK_FORMAT_FILE
    text = text_if_any(path)
    if text is None:
        return None
    try:
        return track_format(tomllib.loads(text))
    except (tomllib.TOMLDecodeError, ValueError) as error:  # msgspec's error is a ValueError
        raise ConfigurationError(f"{path}: {error}") from None


def seconds_of(form: TrackFormat) -> float:
    """One unit of its column of time."""
    return SECONDS[form.time_unit] if form.frames_hz is None else 1 / form.frames_hz


def track_format(settings: dict[str, object]) -> TrackFormat:
    """The format that these settings describe; `preset` gives what they leave out.

    Raises:
        ValueError: unusable; with the key.

    """
    wanted = dict(settings)
    preset = wanted.pop("preset", None)
    if preset is None:
        if "euler" in wanted or "rotation_vector" in wanted:
            wanted.setdefault("quaternion", None)
        return msgspec.convert(wanted, TrackFormat)
    if not isinstance(preset, str) or preset not in PRESETS:
        raise ValueError(f"preset is {preset!r}, expected {' or '.join(map(repr, PRESETS))}")
    return msgspec.convert(msgspec.to_builtins(PRESETS[preset]) | wanted, TrackFormat)
