"""From a 360-degree photo to a room of a robot's calibration."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mbot_protocol.drive.picture import Picture
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.measure.calibration.room.panorama_checks import (
    black_degrees,
    check_projection,
    read_tags,
)
from mbot_workstation.measure.calibration.room.panorama_level import Tilt, find_tilt, level, tilt_of
from mbot_workstation.pictures.picture_file import read_picture, write_picture
from mbot_workstation.sim.calibrated.calibration_folder import ROOMS_FOLDER
from mbot_workstation.sim.scene.room import LARGEST_WIDTH_PX, fit_room

USUAL_WIDTH_PX = 2048
"""As fine as the camera's 320 pixels over 55.3 degrees: 5.7 pixels a degree."""

SMALLEST_TILT_DEG = 0.5
"""Less is within what edges and stitching leave; the picture stays untouched."""

JPEG_QUALITY = 93
MOST_BLACK_DEG = 12.0
"""A tripod's blind spot is smaller; the simulation's own floor hides it anyway."""


@dataclass(frozen=True, slots=True)
class ImportedRoom:
    """A panorama made ready.

    Attributes:
        picture: level, shape (h, 2 h, 3), RGB, its width a power of two.
        pitch_deg, roll_deg: the tilt that was undone.
        tilt: what the upright edges said; None if nothing, or they weren't asked.
        notes: what a person should know.

    """

    picture: Picture
    pitch_deg: float
    roll_deg: float
    tilt: Tilt | None
    notes: tuple[str, ...]


def prepare_room(
    path: Path,
    *,
    width_px: int | None = None,
    heading_deg: float = 0.0,
    tilt_deg: tuple[float, float] | None = None,
    whole: bool = True,
) -> ImportedRoom:
    """Check, level, turn and resize a panorama.

    Args:
        path: the photo.
        width_px: of the result, a power of two; None suits the photo.
        heading_deg: what is so far to the right of its middle comes into the middle.
        tilt_deg: pitch and roll of the camera; None asks the upright edges.
        whole: refuse what does not look like a whole panorama.

    Raises:
        ConfigurationError: it can't be read, or is not a whole panorama.

    """
    picture = read_picture(path)
    tags = read_tags(path.read_bytes())
    if whole:
        check_projection(picture, tags, path.name)
    picture = fit_room(picture, picture.shape[1])
    notes = _black_notes(picture)
    tilt = None
    if tilt_deg is None:
        tilt = find_tilt(picture)
        tilt_deg = (0.0, 0.0)
        if tilt is None:
            notes += (
                "its upright edges don't tell whether it is level: look at the preview, and give "
                "--pitch and --roll if the horizon leans",
            )
            if np.hypot(*tags.pose_deg) > SMALLEST_TILT_DEG:
                pitch, roll = tags.pose_deg
                notes += (f"its file speaks of --pitch {pitch:g} --roll {roll:g}",)
        elif np.hypot(*tilt_of(tilt.vertical)) >= max(SMALLEST_TILT_DEG, 2 * tilt.known_to_deg):
            tilt_deg = tilt_of(tilt.vertical)
    width = width_px or suiting_width(picture.shape[1])
    turned = level(picture, width, *tilt_deg, heading_deg)
    return ImportedRoom(turned, *tilt_deg, tilt, notes)


def suiting_width(width_px: int) -> int:
    """The largest power of two the photo fills, up to what the robot's camera can tell apart."""
    return min(USUAL_WIDTH_PX, 1 << (width_px.bit_length() - 1))


def check_width(width_px: int) -> None:
    """Refuse widths that OpenGL's textures don't like.

    Raises:
        ConfigurationError: it is not a power of two, or out of range.

    """
    if not 256 <= width_px <= LARGEST_WIDTH_PX or width_px & (width_px - 1):
        raise ConfigurationError(
            f"--width is {width_px}, expected a power of two from 256 to {LARGEST_WIDTH_PX}"
        )


def write_room(folder: Path, name: str, picture: Picture) -> Path:
    """Write a room into a calibration folder, whole or not at all.

    Raises:
        ConfigurationError: it can't be written.

    """
    return write_picture(folder / ROOMS_FOLDER / f"{name}.jpg", picture, JPEG_QUALITY)


def _black_notes(picture: Picture) -> tuple[str, ...]:
    top_deg, bottom_deg = black_degrees(picture)
    return tuple(
        f"the {where} {degrees:.0f} degrees are black: nothing was photographed there"
        for where, degrees in (("upper", top_deg), ("lower", bottom_deg))
        if degrees > MOST_BLACK_DEG
    )
