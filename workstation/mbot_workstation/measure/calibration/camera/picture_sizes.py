"""Boards in pictures of several resolutions: one camera only where all show the same view.

A sensor read out at fewer pixels either averages (the same view, everything scaled) or crops (a
narrower view, another camera). The aspect ratio tells some crops, the boards tell the others.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from mbot_protocol.drive.camera_model import CameraModel
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.measure.calibration.camera.board_detection import Sighting

Values = NDArray[np.float64]

ASPECT_TOLERANCE = 0.005
"""2028 x 1520 and 320 x 240 differ by 0.07 %, the crop to 1332 x 990 by 0.84 %."""

CROPPED_MODES = {(1332, 990): "38 x 28.7 degrees", (2028, 1080): "55.3 x 31.2 degrees"}
"""Of the IMX477 behind the 6 mm lens (data sheet)."""

ZOOMS = tuple(float(zoom) for zoom in np.geomspace(0.5, 2.0, 93))
"""Tried when sizes are compared: steps of 1.5 %, from the same view to a quarter of it."""

SAME_VIEW = 0.03
"""Pictures of one view are found within this of zoom 1; crops that sensors do are beyond 0.1."""

CLEARLY_BETTER = 0.5
"""A crop is believed when it halves the error: boards held upright fit any zoom."""


@dataclass(frozen=True, slots=True, eq=False)
class ScaledBoard:
    """A board in a picture as if that were as large as the largest one.

    Attributes:
        points_m: corners on the board, shape (n, 3).
        corners_px: corners in the picture, shape (n, 2).
        scale: by which the picture was enlarged.

    """

    points_m: Values
    corners_px: Values
    scale: float

    @classmethod
    def of(cls, sighting: Sighting, width_px: int, height_px: int) -> "ScaledBoard":
        """A sighting, in a picture of this size."""
        corners = scaled_corners(sighting, width_px, height_px)
        return cls(sighting.board.points_m.astype(float), corners, width_px / sighting.size[0])


def pose_of(view: ScaledBoard, camera: CameraModel) -> Values:
    """The board's rotation vector and translation, refined. Shape (6,); NaN if there is none."""
    known = view.points_m, view.corners_px, camera.matrix, np.array(camera.distortion)
    try:
        found, turn, place = cv2.solvePnP(*known, flags=cv2.SOLVEPNP_IPPE)
        if not found:
            return np.full(6, np.nan)
        turn, place = cv2.solvePnPRefineLM(*known, turn, place)
    except cv2.error:
        return np.full(6, np.nan)
    return np.concatenate([turn.ravel(), place.ravel()]).astype(np.float64)


def residuals(view: ScaledBoard, camera: CameraModel, pose: Values) -> Values:
    """Projected minus seen corners. Shape (n, 2)."""
    lens = np.array(camera.distortion)
    seen, _ = cv2.projectPoints(view.points_m, pose[:3], pose[3:], camera.matrix, lens)
    return np.asarray(seen, np.float64).reshape(-1, 2) - view.corners_px


def error_px(view: ScaledBoard, camera: CameraModel) -> float:
    """Root mean square distance in pixels between seen corners and those of the best pose."""
    apart = residuals(view, camera, pose_of(view, camera))
    return float(np.sqrt((apart**2).sum(axis=1).mean()))


def scaled_corners(sighting: Sighting, width_px: int, height_px: int) -> Values:
    """The corners as they would be in a picture of another size. Shape (n, 2)."""
    share = np.array([width_px / sighting.size[0], height_px / sighting.size[1]])
    return (sighting.board.corners_px.astype(float) + 0.5) * share - 0.5


def commonest_size(sightings: Sequence[Sighting]) -> tuple[int, int]:
    """The size most pictures have; the larger one if two are as common."""
    counts = Counter(sighting.size for sighting in sightings)
    return max(counts, key=lambda size: (counts[size], size))


def check_aspects(sightings: Sequence[Sighting]) -> None:
    """Refuse pictures of different shapes.

    Raises:
        ConfigurationError: two sizes have different aspect ratios.

    """
    most = commonest_size(sightings)
    for sighting in sightings:
        own, usual = sighting.size[0] / sighting.size[1], most[0] / most[1]
        if abs(own / usual - 1) > ASPECT_TOLERANCE:
            raise _other_view(
                sightings, sighting.size, f"an aspect ratio of {own:.4f} against {usual:.4f}"
            )


def check_zooms(sightings: Sequence[Sighting], camera: CameraModel) -> None:
    """Refuse pictures that show a part of the view only.

    Args:
        sightings: all of them, of one aspect ratio.
        camera: fitted to those of the commonest size, at the largest size.

    Raises:
        ConfigurationError: the boards in pictures of another size are too large or too small.

    """
    for size in {sighting.size for sighting in sightings} - {commonest_size(sightings)}:
        views = [
            ScaledBoard.of(sighting, camera.width_px, camera.height_px)
            for sighting in sightings
            if sighting.size == size
        ]
        errors: dict[float, float] = {}
        for zoom in (1.0, *ZOOMS):
            x, y = zoom * camera.focal_x_px, zoom * camera.focal_y_px
            zoomed = replace(camera, focal_x_px=x, focal_y_px=y)
            errors[zoom] = float(np.nanmedian([error_px(view, zoomed) for view in views]))
        zoom = min(errors, key=lambda zoom: errors[zoom])
        if abs(zoom - 1) > SAME_VIEW and errors[zoom] < CLEARLY_BETTER * errors[1.0]:
            raise _other_view(sightings, size, f"their boards fit a view {zoom:.2f} times as long")


def _other_view(
    sightings: Sequence[Sighting], size: tuple[int, int], why: str
) -> ConfigurationError:
    most = commonest_size(sightings)
    names = [sighting.name for sighting in sightings if sighting.size == size]
    usual = sum(sighting.size == most for sighting in sightings)
    mode = CROPPED_MODES.get(size) or CROPPED_MODES.get(most)
    known = f" (a sensor mode that crops to {mode})" if mode else ""
    return ConfigurationError(
        f"{len(names)} pictures of {size[0]} x {size[1]}, such as {names[0]}, show another view "
        f"than the {usual} of {most[0]} x {most[1]}: {why}{known}; calibrate with pictures of the "
        "one mode the robot drives with"
    )
