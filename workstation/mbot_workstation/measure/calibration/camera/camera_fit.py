"""From board corners in many pictures to one camera, with the pictures that don't fit left out.

OpenCV fits; on the same corners a bundle adjustment of our own found the same cameras
(docs/results/camera.md). What it lacks is here: which pictures to believe, and how far.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from mbot_protocol.drive.camera_model import CameraModel
from mbot_protocol.drive.lens import folds_within
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.measure.calibration.camera.board_detection import Sighting
from mbot_workstation.measure.calibration.camera.picture_sizes import (
    ScaledBoard,
    Values,
    check_aspects,
    check_zooms,
    commonest_size,
    error_px,
    pose_of,
    residuals,
)

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

USUAL_ERROR = 1e-4
"""Of the picture's width: how far corners of good pictures are off."""

MOST_ROUNDS = 10
"""Of leaving pictures out and fitting again; two or three settle it."""

MOST_REFITS = 20
"""For the deviations: each without another part of the pictures."""

INTRINSICS = (
    *("focal_x_px", "focal_y_px", "principal_x_px", "principal_y_px"),
    *("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
)
"""In the order of deviations; k4 to k6 of wide lenses only."""

_ROUGH = cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3
_FINER = (_ROUGH | cv2.CALIB_FIX_PRINCIPAL_POINT, _ROUGH, cv2.CALIB_FIX_K3)
"""From a rough focal length, or pulled by spoilt pictures, the finer terms might run away."""

_K3 = INTRINSICS.index("k3")


@dataclass(frozen=True, slots=True, eq=False)
class PictureFit:
    """How one picture fits.

    Attributes:
        sighting: what was seen in it.
        error_px: root mean square distance of its corners, in its own pixels.
        kept: whether the camera was fitted to it.
        pose: rotation vector and translation of the board, shape (6,).
        residuals_px: projected minus seen corners in its own pixels, shape (n, 2).

    """

    sighting: Sighting
    error_px: float
    kept: bool
    pose: Values
    residuals_px: Values


@dataclass(frozen=True, slots=True, eq=False)
class CameraFit:
    """A calibrated camera and how well it is known.

    Attributes:
        camera: at the largest resolution among the pictures.
        deviations: standard deviations of its intrinsics, as in `INTRINSICS`; shape (9,) or (12,).
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
        keep_outliers: fit to all pictures alike, as OpenCV does.

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
    views = [ScaledBoard.of(sighting, width_px, height_px) for sighting in sightings]
    camera = _rough_camera(sightings, views, width_px, height_px)
    kept, limit = np.ones(len(views), bool), np.inf
    if not keep_outliers:
        kept, limit = _believed(views, camera)
    some = [view for view, keeps in zip(views, kept, strict=True) if keeps]
    camera, deviations = solve(some, camera)
    flags = 0
    if not keep_outliers and abs(camera.distortion[4]) <= 2 * deviations[_K3]:
        flags = cv2.CALIB_FIX_K3
        start = replace(camera, distortion=(*camera.distortion[:4], 0.0))
        camera, deviations = solve(some, start, flags)
    if folds_within(camera):
        camera, deviations, flags = _unfolded(some, camera, coarser=not keep_outliers)
    spread = np.maximum(deviations, _by_pictures(some, camera, flags))
    pictures = tuple(
        _judge(view, camera, sighting, bool(keeps))
        for view, sighting, keeps in zip(views, sightings, kept, strict=True)
    )
    return CameraFit(camera, spread, pictures, float(limit), not flags & cv2.CALIB_FIX_K3)


def _unfolded(
    views: Sequence[ScaledBoard], start: CameraModel, *, coarser: bool
) -> tuple[CameraModel, Values, int]:
    """In place of one whose picture folds over: a camera, its deviations, OpenCV's flags for it.

    It may be a wide lens, which OpenCV's rational model follows, as that keeps rising further out.
    Or the finest terms bend where no board was seen: what does not is preferred then, if corners
    fit it nearly as well.
    """
    tried: list[tuple[float, CameraModel, Values, int]] = []
    k1, k2, p1, p2, _ = start.distortion
    ways = (
        ((0.0,) * 8, cv2.CALIB_RATIONAL_MODEL),
        ((k1, k2, p1, p2, 0.0), cv2.CALIB_FIX_K3),
        ((k1, 0.0, p1, p2, 0.0), cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3),
    )
    for distortion, flags in ways if coarser else ways[:1]:
        camera, deviations = solve(views, replace(start, distortion=distortion), flags)
        apart = np.concatenate([residuals(v, camera, pose_of(v, camera)).ravel() for v in views])
        tried.append((float(np.sqrt(2 * (apart**2).mean())), camera, deviations, flags))
    tried.sort(key=lambda one: one[0])
    most_px = tried[0][0] + USUAL_ERROR * start.width_px
    good = [one for one in tried if one[0] <= most_px and not folds_within(one[1])]
    return (good or tried)[0][1:]


def solve(
    views: Sequence[ScaledBoard], start: CameraModel, flags: int = 0
) -> tuple[CameraModel, Values]:
    """The camera that fits all corners best, by OpenCV.

    Args:
        views: at least 3, of pictures as large as the camera's.
        start: near the camera.
        flags: OpenCV's, for what to fit.

    Returns:
        The camera; and standard deviations of its intrinsics, by the scatter of single corners,
        shape (9,), or (12,) of a rational model.

    Raises:
        ConfigurationError: OpenCV finds no camera.

    """
    try:
        _, matrix, distortion, _, _, deviations, *_ = cv2.calibrateCameraExtended(
            [view.points_m.astype(np.float32) for view in views],
            [view.corners_px.astype(np.float32) for view in views],
            (start.width_px, start.height_px),
            start.matrix,
            np.array(start.distortion),
            flags=cv2.CALIB_USE_INTRINSIC_GUESS | flags,
        )
        terms = len(start.distortion)
        numbers = np.asarray(distortion, np.float64).ravel()[:terms].tolist()
        fx, fy, cx, cy = np.asarray(matrix, np.float64).ravel()[[0, 4, 2, 5]].tolist()
        camera = CameraModel(start.width_px, start.height_px, fx, fy, cx, cy, tuple(numbers))
    except (cv2.error, ValueError) as error:
        raise ConfigurationError(f"these pictures fit no camera: {error}") from None
    return camera, np.asarray(deviations, np.float64).ravel()[: 4 + terms]


def _rough_camera(
    sightings: Sequence[Sighting], views: Sequence[ScaledBoard], width_px: int, height_px: int
) -> CameraModel:
    """A camera to start from, after a look whether pictures of all sizes show the same view."""
    up = height_px / width_px
    guesses = [
        CameraModel.from_field_of_view(
            width_px, height_px, deg, np.degrees(2 * np.arctan(np.tan(np.radians(deg) / 2) * up))
        )
        for deg in FIELDS_OF_VIEW_DEG
    ]
    guess = min(guesses, key=lambda one: float(np.nanmedian([error_px(v, one) for v in views])))
    most = commonest_size(sightings)
    usual = [v for v, sighting in zip(views, sightings, strict=True) if sighting.size == most]
    if FEWEST_OF_A_SIZE <= len(usual) < len(views):
        kept, _ = _believed(usual, solve(usual, guess, _FINER[0])[0])
        fitted, _ = solve([v for v, keeps in zip(usual, kept, strict=True) if keeps], guess)
        check_zooms(sightings, fitted)
    return solve(views, guess, _FINER[0])[0]


def _believed(views: Sequence[ScaledBoard], start: CameraModel) -> tuple[NDArray[np.bool_], float]:
    """Which views fit the others, shape (n,), and the error in pixels above which one does not.

    Fitted to all, the camera is pulled by the spoilt ones, but they still stand out; without them
    others do, or do no more.
    """
    camera, kept, limit = start, np.ones(len(views), bool), np.inf
    for number in range(MOST_ROUNDS):
        errors = np.array([error_px(view, camera) / view.scale for view in views])
        middle = float(np.nanmedian(errors))
        spread = 1.4826 * float(np.nanmedian(np.abs(errors - middle)))
        limit = max(LIMIT_MEDIANS * middle, middle + LIMIT_DEVIATIONS * spread)
        before, kept = kept, errors <= limit
        if number >= len(_FINER) and (kept == before).all():
            break
        some = [view for view, keeps in zip(views, kept, strict=True) if keeps]
        camera, _ = solve(some, camera, _FINER[number] if number < len(_FINER) else 0)
    return kept, limit


def _by_pictures(views: Sequence[ScaledBoard], camera: CameraModel, flags: int) -> Values:
    """Standard deviations by how much the camera moves without some of the pictures (jackknife).

    Corners of a picture err together, where the board is bent or blurred, so that the scatter of
    single ones alone would be too sure. Shape as of `deviations`.
    """
    parts = min(len(views), MOST_REFITS)
    if len(views) <= FEWEST_PICTURES:
        return np.zeros(4 + len(camera.distortion))
    without = [[v for number, v in enumerate(views) if number % parts != p] for p in range(parts)]
    found = [solve(some, camera, flags)[0] for some in without]
    values = np.array([[*one.matrix.ravel()[[0, 4, 2, 5]], *one.distortion] for one in found])
    return np.sqrt((parts - 1) * values.var(axis=0))


def _judge(view: ScaledBoard, camera: CameraModel, sighting: Sighting, kept: bool) -> PictureFit:
    pose = pose_of(view, camera)
    apart = residuals(view, camera, pose) / view.scale
    error = float(np.sqrt((apart**2).sum(axis=1).mean()))
    return PictureFit(sighting, error, kept, pose, apart)
