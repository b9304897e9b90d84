"""Whether a picture is a whole 360-degree photo, and if not, what it is."""

import re
from dataclasses import dataclass

import cv2
import numpy as np

from mbot_protocol.drive.picture import Picture
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.pictures.picture_file import read_xmp
from mbot_workstation.sim.scene.room import ASPECT_TOLERANCE, SMALLEST_WIDTH_PX

SEAM_SHARE, SEAM_LEVELS = 1.5, 2.0
"""The left and right edge are neighbours: they may differ by this much of what the 1 % sharpest
edges between columns show, and by some noise. Six real rooms: at most 1.0; cut ones 2.2 to 13."""

POLE_LEVELS = 14.0
"""The upper row is one point of the ceiling, the lower one of the floor: spread along them. Six
real rooms: at most 5.5; flat pictures 11 to 90."""

PLAIN_LEVELS = 3.0
"""Spread along a column of a frame; along any column of six real rooms it is 27 or more."""

BLACK_BELOW = 12
_GPANO = b"http://ns.google.com/photos/1.0/panorama/"


@dataclass(frozen=True, slots=True)
class PanoramaTags:
    """What the camera or stitcher has written into the file (Google's Photo Sphere XMP).

    Attributes:
        projection: "equirectangular", or another; "" if nothing is said.
        share: of the full turn and the full height that the picture covers; 1 if nothing is said.
        pose_deg: pitch and roll of the camera; 0 if nothing is said.

    """

    projection: str = ""
    share: tuple[float, float] = (1.0, 1.0)
    pose_deg: tuple[float, float] = (0.0, 0.0)


def read_tags(data: bytes) -> PanoramaTags:
    """The tags of a file; what is missing or no number counts as not said."""
    found = _photo_sphere(read_xmp(data))
    shares = [
        _share(found, "CroppedAreaImageWidthPixels", "FullPanoWidthPixels"),
        _share(found, "CroppedAreaImageHeightPixels", "FullPanoHeightPixels"),
    ]
    return PanoramaTags(
        found.get("ProjectionType", "").lower(),
        (shares[0], shares[1]),
        (_number(found, "PosePitchDegrees", 0.0), _number(found, "PoseRollDegrees", 0.0)),
    )


def _photo_sphere(xmp: bytes) -> dict[str, str]:
    """What stands there, as attributes or as elements; nothing where entities are declared."""
    prefix = re.search(rb"""xmlns:([\w.-]+)\s*=\s*["']%s["']""" % re.escape(_GPANO), xmp)
    if prefix is None or b"<!DOCTYPE" in xmp:
        return {}
    told = rb"""(?<![\w/])%s:(\w+)(?:\s*=\s*["']([^"'<]*)["']|\s*>([^<]*)<)""" % re.escape(
        prefix[1]
    )
    return {
        name.decode(): (attribute or element).decode(errors="replace").strip()
        for name, attribute, element in re.findall(told, xmp)
    }


def check_projection(picture: Picture, tags: PanoramaTags, name: str) -> None:
    """Refuse what is not a whole equirectangular panorama.

    Args:
        picture: RGB.
        tags: of its file.
        name: for messages.

    Raises:
        ConfigurationError: it is none, or a part of one.

    """
    height, width = picture.shape[:2]
    wanted = (
        "expected a 360-degree photo (equirectangular), twice as wide as high: export it as a full "
        "panorama"
    )
    if tags.projection not in {"", "equirectangular"}:
        raise ConfigurationError(f"{name} has a {tags.projection} projection, {wanted}")
    if width < SMALLEST_WIDTH_PX or abs(width / height - 2) > 2 * ASPECT_TOLERANCE:
        raise ConfigurationError(
            f"{name} is {width} x {height}, {_shape_words(width / height)}; {wanted}"
        )
    if min(tags.share) < 1 - ASPECT_TOLERANCE:
        raise ConfigurationError(
            f"{name} covers {360 * tags.share[0]:.0f} x {180 * tags.share[1]:.0f} degrees, {wanted}"
        )
    if float(picture[:, :: -(-width // SMALLEST_WIDTH_PX)].std(axis=0).max()) < PLAIN_LEVELS:
        raise ConfigurationError(f"{name} is of one colour from top to bottom, {wanted}")
    if _is_two_circles(picture):
        raise ConfigurationError(
            f"{name} shows two round fisheye pictures side by side, not stitched yet; {wanted} in "
            "the camera's app"
        )
    if _has_frame(picture):
        raise ConfigurationError(
            f"{name} has a plain frame around it, as drawings and screenshots have; {wanted}"
        )
    seam, usual = seam_difference(picture)
    if seam > SEAM_SHARE * usual + SEAM_LEVELS:
        raise ConfigurationError(
            f"{name} does not close: its left and right edge differ by {seam:.0f} levels, expected "
            f"at most {SEAM_SHARE * usual + SEAM_LEVELS:.0f}; it is cut, or no 360-degree photo; "
            f"{wanted}"
        )
    spread = max(_spread(picture[0]), _spread(picture[-1]))
    if spread > POLE_LEVELS:
        raise ConfigurationError(
            f"{name} has an upper or lower edge with different things on it (spread {spread:.0f} "
            f"levels, expected at most {POLE_LEVELS:.0f}), where a panorama has one point of the "
            f"ceiling or floor; it is cut, or no 360-degree photo; {wanted}"
        )


def seam_difference(picture: Picture) -> tuple[float, float]:
    """Mean difference of the outer columns, and of the sharpest 1 % of neighbours, in levels."""
    seam = float(cv2.absdiff(picture[:, 0], picture[:, -1]).mean())
    neighbours = cv2.absdiff(picture[:, 1:], picture[:, :-1]).mean(axis=(0, 2))
    return seam, float(np.percentile(neighbours, 99))


def black_degrees(picture: Picture) -> tuple[float, float]:
    """How many degrees at the top and at the bottom are black, since nothing was photographed."""
    dark = picture.max(axis=(1, 2)) < BLACK_BELOW
    if dark.all():
        return 180.0, 180.0
    a_row = 180 / len(dark)
    return float(np.argmin(dark) * a_row), float(np.argmin(dark[::-1]) * a_row)


def _spread(row: Picture) -> float:
    """Standard deviation along a row, without its noise."""
    wide = max(3, len(row) // 64)
    return float(cv2.blur(row[None], (wide, 1))[0].std(axis=0).mean())


def _has_frame(picture: Picture) -> bool:
    """Whether both outer columns are of one colour, though the middle one is not."""
    edges = max(float(picture[:, column].std(axis=0).max()) for column in (0, -1))
    middle = float(picture[:, picture.shape[1] // 2].std(axis=0).max())
    return edges < PLAIN_LEVELS < middle / 4


def _is_two_circles(picture: Picture) -> bool:
    """Whether everything outside of two circles, side by side, is black."""
    small = cv2.resize(picture, (128, 64), interpolation=cv2.INTER_AREA).max(axis=2)
    row, column = np.indices(small.shape)
    radius = np.hypot(row - 31.5, np.minimum(abs(column - 31.5), abs(column - 95.5)))
    return bool(np.median(small[radius > 34]) < BLACK_BELOW < np.median(small[radius < 25]))


def _shape_words(ratio: float) -> str:
    """What pictures of this shape usually are."""
    if ratio > 2.08:
        return (
            "a strip such as phones make by sweeping, without ceiling and floor"
            if ratio < 5
            else "a strip, or the six sides of a cube in a row"
        )
    if abs(ratio - 1) < 0.05:
        return "square: two panoramas for two eyes, or a little planet"
    return "a common flat photo, or a part of a panorama"


def _share(tags: dict[str, str], part: str, whole: str) -> float:
    all_px = _number(tags, whole, 0.0)
    return _number(tags, part, all_px) / all_px if all_px > 0 else 1.0


def _number(tags: dict[str, str], name: str, default: float) -> float:
    try:
        value = float(tags[name])
    except (KeyError, ValueError):
        return default
    return value if np.isfinite(value) else default
