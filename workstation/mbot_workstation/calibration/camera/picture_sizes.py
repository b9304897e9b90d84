"""Pictures of several resolutions: one camera only where all show the same view.

A sensor read out at fewer pixels either averages (the same view, everything scaled) or crops (a
narrower view, another camera). The aspect ratio tells some crops, the boards tell the others.
"""

from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.calibration.camera.bundle import Values, View, error_px, pose_of
from mbot_workstation.calibration.camera.sighting import Sighting

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


def scaled_corners(sighting: Sighting, width_px: int, height_px: int) -> NDArray[np.float64]:
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


def check_zooms(sightings: Sequence[Sighting], intrinsics: Values) -> None:
    """Refuse pictures that show a part of the view only.

    Args:
        sightings: all of them, of one aspect ratio.
        intrinsics: fitted to those of the commonest size, shape (9,), at the largest size.

    Raises:
        ConfigurationError: the boards in pictures of another size are too large or too small.

    """
    largest = max(sighting.size for sighting in sightings)
    most = commonest_size(sightings)
    for size in {sighting.size for sighting in sightings} - {most}:
        views = [
            View(sighting.board.points_m.astype(float), scaled_corners(sighting, *largest))
            for sighting in sightings
            if sighting.size == size
        ]
        errors = {zoom: _zoomed_error(views, intrinsics, zoom) for zoom in (1.0, *ZOOMS)}
        zoom = min(errors, key=lambda zoom: errors[zoom])
        if abs(zoom - 1) > SAME_VIEW and errors[zoom] < CLEARLY_BETTER * errors[1.0]:
            raise _other_view(sightings, size, f"their boards fit a view {zoom:.2f} times as long")


def _zoomed_error(views: Sequence[View], intrinsics: Values, zoom: float) -> float:
    zoomed = intrinsics.copy()
    zoomed[:2] *= zoom
    return float(np.nanmedian([error_px(view, zoomed, pose_of(view, zoomed)) for view in views]))


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
