"""From board corners in many pictures to one camera, with the pictures that don't fit left out."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbot_protocol.camera_model import CameraModel
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.lens import folds_within
from mbot_workstation.calibration.camera.bundle import (
    Adjusted,
    Values,
    View,
    adjust,
    camera_of,
    error_px,
    intrinsics_of,
    pose_of,
    residuals,
)
from mbot_workstation.calibration.camera.picture_sizes import (
    check_aspects,
    check_zooms,
    commonest_size,
    scaled_corners,
)
from mbot_workstation.calibration.camera.sighting import Sighting
from mbot_workstation.calibration.camera.wide_lens import wide_fit

FEWEST_PICTURES = 3
"""9 intrinsics and 6 numbers a pose: two pictures of a plane can't tell them."""

FEWEST_OF_A_SIZE = 5
"""To fit a camera to, which the pictures of other sizes are then compared with."""

FIELDS_OF_VIEW_DEG = tuple(float(value) for value in np.geomspace(20, 120, 13))
"""Horizontal, to start from; the nearest one is within 8 %, and the fit finds the rest."""

LIMIT_DEVIATIONS, LIMIT_MEDIANS = 3.0, 3.0
"""A picture is left out when its error is above 3 times the median, and above the median by more
than 3 standard deviations (1.48 times the median deviation). Sharp pictures of a flat board are
within twice the median, shaken ones beyond 5 times (drawn pictures)."""

ROBUST_ROUNDS = 5
_P1, _P2, _K2, _K3 = 6, 7, 5, 8


@dataclass(frozen=True, slots=True)
class PictureFit:
    """How one picture fits.

    Attributes:
        sighting: what was seen in it.
        error_px: root mean square distance of its corners, in its own pixels.
        kept: whether the camera was fitted to it.
        pose: rotation vector and translation of the board, shape (6,); metres.
        residuals_px: projected minus seen, shape (n, 2), in its own pixels.

    """

    sighting: Sighting
    error_px: float
    kept: bool
    pose: Values
    residuals_px: Values


@dataclass(frozen=True, slots=True)
class CameraFit:
    """A calibrated camera and how well it is known.

    Attributes:
        camera: at the largest resolution among the pictures.
        deviations: standard deviations of the intrinsics, in the order of `bundle.INTRINSICS`,
            shape (9,), or `WIDE_INTRINSICS`, shape (12,).
        pictures: in the order they came.
        limit_px: error above which a picture was left out.
        k3_is_told: whether the pictures tell k3 from 0; if not, it is 0.

    """

    camera: CameraModel
    deviations: Values
    pictures: tuple[PictureFit, ...]
    limit_px: float
    k3_is_told: bool

    @property
    def kept(self) -> tuple[PictureFit, ...]:
        """The pictures that were fitted."""
        return tuple(picture for picture in self.pictures if picture.kept)

    @property
    def error_px(self) -> float:
        """Root mean square distance over all corners kept, in each picture's own pixels."""
        squares = [(picture.residuals_px**2).sum(axis=1) for picture in self.kept]
        return float(np.sqrt(np.concatenate(squares).mean()))


def fit_camera(sightings: Sequence[Sighting], *, keep_outliers: bool = False) -> CameraFit:
    """Fit a camera.

    Args:
        sightings: boards found in pictures of one camera; resolutions may differ.
        keep_outliers: fit to all pictures alike.

    Raises:
        ConfigurationError: too few pictures, or they were taken with different views.

    """
    if len(sightings) < FEWEST_PICTURES:
        raise ConfigurationError(
            f"the board was found in {len(sightings)} pictures, expected at least "
            f"{FEWEST_PICTURES}, better 20"
        )
    check_aspects(sightings)
    width_px, height_px = max(sighting.size for sighting in sightings)
    views = [
        View(
            sighting.board.points_m.astype(float),
            scaled_corners(sighting, width_px, height_px),
        )
        for sighting in sightings
    ]
    scales = np.array([width_px / sighting.size[0] for sighting in sightings])
    start = _first_guess(views, width_px, height_px)
    start = _checked_for_crops(sightings, views, start)
    robust = _robust_fit(views, start, 1 / scales**2)
    errors = robust.errors_px / scales
    kept, limit = np.ones(len(views), bool), np.inf
    if not keep_outliers:
        for _ in range(2):
            limit = _limit(errors)
            kept = errors <= limit
            found = _fit(views, robust, kept, scales)
            errors = _errors(views, found.intrinsics) / scales
    found = _fit(views, robust, kept, scales)
    # Told to fit everything, do as OpenCV's calibrateCamera does.
    k3_is_told = keep_outliers or abs(found.intrinsics[_K3]) > 2 * found.deviations[_K3]
    if not k3_is_told:
        without = Adjusted(found.intrinsics.copy(), found.deviations, robust.poses, errors)
        without.intrinsics[_K3] = 0
        found = _fit(views, without, kept, scales, held=(_K3,))
    try:
        camera = camera_of(found.intrinsics, width_px, height_px)
    except ValueError as error:
        raise ConfigurationError(f"these pictures fit no camera: {error}") from None
    if folds_within(camera):
        wide = wide_fit(views, kept, found.intrinsics, (width_px, height_px))
        found, camera = wide, camera_of(wide.intrinsics, width_px, height_px)
        k3_is_told = True
    pictures = tuple(
        _judge(view, found.intrinsics, sighting, float(scale), bool(keeps))
        for view, sighting, scale, keeps in zip(views, sightings, scales, kept, strict=True)
    )
    return CameraFit(camera, found.deviations, pictures, float(limit), k3_is_told)


def _checked_for_crops(
    sightings: Sequence[Sighting], views: Sequence[View], start: Values
) -> Values:
    """Intrinsics to start from, after a look whether all sizes show the same view."""
    most = commonest_size(sightings)
    usual = [v for v, sighting in zip(views, sightings, strict=True) if sighting.size == most]
    if not FEWEST_OF_A_SIZE <= len(usual) < len(views):
        return start
    intrinsics = _robust_fit(usual, start, np.ones(len(usual))).intrinsics
    check_zooms(sightings, intrinsics)
    return intrinsics


def _judge(
    view: View, intrinsics: Values, sighting: Sighting, scale: float, kept: bool
) -> PictureFit:
    pose = pose_of(view, intrinsics)
    apart = residuals(view, intrinsics, pose) / scale
    error = float(np.sqrt((apart**2).sum(axis=1).mean()))
    return PictureFit(sighting, error, kept, pose, apart)


def _first_guess(views: Sequence[View], width_px: int, height_px: int) -> Values:
    """A camera without distortion whose field of view suits most of the pictures."""
    guesses = [
        intrinsics_of(
            CameraModel.from_field_of_view(
                width_px,
                height_px,
                fov_deg,
                np.degrees(2 * np.arctan(np.tan(np.radians(fov_deg) / 2) * height_px / width_px)),
            )
        )
        for fov_deg in FIELDS_OF_VIEW_DEG
    ]
    return min(guesses, key=lambda guess: float(np.nanmedian(_errors(views, guess))))


def _errors(views: Sequence[View], intrinsics: Values) -> Values:
    return np.array([error_px(view, intrinsics, pose_of(view, intrinsics)) for view in views])


def _robust_fit(views: Sequence[View], start: Values, base: Values) -> Adjusted:
    """A fit in which a picture counts less the worse it fits, so that a few bad ones do no harm.

    Cauchy weights on whole pictures, scaled by twice the median error.
    """
    errors = _errors(views, start) * np.sqrt(base)
    usable = np.isfinite(errors)
    poses = np.array([pose_of(view, start) for view in views])
    found = Adjusted(start, np.zeros(len(start)), poses, errors)
    for number in range(ROBUST_ROUNDS):
        # From a rough focal length the finer terms of the distortion might run away.
        held = (_K2, _P1, _P2, _K3) if number == 0 else ()
        weights = base / (1 + (errors / (2 * np.nanmedian(errors))) ** 2)
        some = [view for view, use in zip(views, usable, strict=True) if use]
        found = adjust(some, found.intrinsics, poses[usable], weights[usable], held)
        poses = np.array([pose_of(view, found.intrinsics) for view in views])
        errors = _errors(views, found.intrinsics) * np.sqrt(base)
        usable = np.isfinite(errors)
    return Adjusted(found.intrinsics, found.deviations, poses, errors / np.sqrt(base))


def _limit(errors: Values) -> float:
    middle = float(np.nanmedian(errors))
    spread = 1.4826 * float(np.nanmedian(np.abs(errors - middle)))
    return max(LIMIT_MEDIANS * middle, middle + LIMIT_DEVIATIONS * spread)


def _fit(
    views: Sequence[View],
    start: Adjusted,
    kept: np.ndarray,
    scales: Values,
    held: Sequence[int] = (),
) -> Adjusted:
    """A fit to the pictures that are kept, each corner with the same error in its own pixels."""
    some = [view for view, keeps in zip(views, kept, strict=True) if keeps]
    return adjust(some, start.intrinsics, start.poses[kept], 1 / scales[kept] ** 2, held)
