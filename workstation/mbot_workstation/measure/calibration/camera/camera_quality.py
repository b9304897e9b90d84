"""Whether a camera's calibration can be trusted, and what more pictures would help."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from mbot_protocol.drive.camera_model import (
    PI_CAMERA_HORIZONTAL_FOV_DEG,
    PI_CAMERA_VERTICAL_FOV_DEG,
    CameraModel,
)
from mbot_protocol.drive.lens import folds_within, ray_slope
from mbot_workstation.measure.calibration.camera.camera_fit import CameraFit, PictureFit
from mbot_workstation.measure.calibration.camera.picture_sizes import scaled_corners

FEWEST_POSES = 8
"""Rendered boards gave 0.3 % from 8 poses on and 0.05 % from 20."""

FEWEST_TILTED_DEG = 20.0
"""Between the two boards turned most differently: focal length and distance only differ in how
lines converge."""

SAME_POSE_DEG, SAME_POSE_SHARE = 3.0, 0.05
"""Two boards are in one pose if turned by less, and moved by less than this of their distance."""

WORST_FOCAL, NOTED_FOCAL = 0.02, 0.01
"""Half the 95 % interval of the focal lengths, relative: 1 % is 0.3 degrees at the edge of the Pi
camera's view. Half of what training varies the view by (4 %, `variation.presets`) is left to what
else is not known."""

WORST_ERROR = 0.001
"""Of the picture's width: bent boards and shaken cameras are beyond, a tenth of it is usual."""

FEWEST_AREAS = 6
"""Of the 9 areas of the view with corners in them."""

FEWEST_IN_AREA = 8
"""Corners without which an area counts as empty; a board that only touches it says little."""

_MORE_TILTED = "more pictures with the board tilted, filling the view"

MOST_LEFT_OUT = 1 / 3

NARROW = ("k1", "k2", "p1", "p2", "k3")

AREAS = (
    *("upper left", "upper middle", "upper right"),
    *("middle left", "middle", "middle right"),
    *("lower left", "lower middle", "lower right"),
)


@dataclass(frozen=True, slots=True)
class CameraQuality:
    """The verdict.

    Attributes:
        objections: why it is too poor to be used, each with its remedy; none if it is good.
        notes: what a person should know all the same.
        empty_areas: of the view, where no picture has a corner.
        poses: really different ones.
        tilt_deg: between the two boards turned most differently.

    """

    objections: tuple[str, ...]
    notes: tuple[str, ...]
    empty_areas: tuple[str, ...]
    poses: int
    tilt_deg: float


def judge(fit: CameraFit) -> CameraQuality:
    """Look a fit over."""
    camera = fit.camera
    empty = empty_areas(fit)
    poses = different_poses(fit.kept)
    tilt_deg = _largest_tilt_deg(fit.kept)
    uncertain = float(max(2 * fit.deviations[:2] / (camera.focal_x_px, camera.focal_y_px)))
    left_out = len(fit.pictures) - len(fit.kept)
    objections: list[str] = []
    if poses < FEWEST_POSES:
        objections.append(
            f"{len(fit.kept)} pictures show {poses} different poses of the board, expected at "
            f"least {FEWEST_POSES}, better 20: hold it elsewhere, nearer, turned"
        )
    if tilt_deg < FEWEST_TILTED_DEG:
        objections.append(
            f"the board is always held the same way (within {tilt_deg:.0f} degrees), expected "
            f"{FEWEST_TILTED_DEG:.0f} or more: tilt it left, right, up and down"
        )
    if uncertain > WORST_FOCAL:
        objections.append(
            f"the focal length is known to +-{100 * uncertain:.1f} % only, expected "
            f"{100 * WORST_FOCAL:g}: {_MORE_TILTED}"
        )
    if len(empty) > len(AREAS) - FEWEST_AREAS:
        objections.append(
            f"no picture has the board in the {_listed(empty)} of the view: the lens's distortion "
            "there would be a guess"
        )
    if fit.error_px > WORST_ERROR * camera.width_px:
        objections.append(
            f"corners are off by {fit.error_px:.2f} px on average, expected below "
            f"{WORST_ERROR * camera.width_px:.1f}: is the board flat, and the camera still?"
        )
    if left_out > MOST_LEFT_OUT * len(fit.pictures):
        objections.append(
            f"{left_out} of {len(fit.pictures)} pictures don't fit the others, expected a few: "
            "are they from one camera, with one focus and zoom?"
        )
    return CameraQuality(
        tuple(objections), _notes(fit, empty, uncertain, len(objections)), empty, poses, tilt_deg
    )


def empty_areas(fit: CameraFit) -> tuple[str, ...]:
    """Names of those of the 9 areas of the view in which no picture kept has a corner."""
    size = fit.camera.width_px, fit.camera.height_px
    corners = [scaled_corners(picture.sighting, *size) for picture in fit.kept]
    return areas_without(np.concatenate(corners) if corners else np.zeros((0, 2)), *size)


def areas_without(corners: NDArray[np.floating], width_px: int, height_px: int) -> tuple[str, ...]:
    """Names of the areas with hardly any of these corners, shape (n, 2)."""
    columns = np.clip(((corners[:, 0] + 0.5) / width_px * 3).astype(int), 0, 2)
    rows = np.clip(((corners[:, 1] + 0.5) / height_px * 3).astype(int), 0, 2)
    seen = np.bincount(3 * rows + columns, minlength=len(AREAS))
    return tuple(name for name, number in zip(AREAS, seen, strict=True) if number < FEWEST_IN_AREA)


def different_poses(pictures: Sequence[PictureFit]) -> int:
    """How many of these pictures show the board in another pose than those before."""
    kept: list[PictureFit] = []
    for picture in pictures:
        if not any(_same_pose(picture, other) for other in kept):
            kept.append(picture)
    return len(kept)


def _same_pose(one: PictureFit, other: PictureFit) -> bool:
    turned_deg = np.degrees(np.linalg.norm(_between(one, other)))
    moved_m = np.linalg.norm(one.pose[3:] - other.pose[3:])
    return bool(
        turned_deg < SAME_POSE_DEG and moved_m < SAME_POSE_SHARE * np.linalg.norm(other.pose[3:])
    )


def _between(one: PictureFit, other: PictureFit) -> NDArray[np.float64]:
    """The turn from one board to the other as a rotation vector. Shape (3,)."""
    first, second = (cv2.Rodrigues(picture.pose[:3])[0] for picture in (one, other))
    return np.asarray(cv2.Rodrigues(first.T @ second)[0], np.float64).ravel()


def _largest_tilt_deg(pictures: Sequence[PictureFit]) -> float:
    normals = np.array([cv2.Rodrigues(picture.pose[:3])[0][:, 2] for picture in pictures])
    return float(np.degrees(np.arccos(np.clip(normals @ normals.T, -1, 1).min())))


def _notes(
    fit: CameraFit, empty: Sequence[str], uncertain: float, objections: int
) -> tuple[str, ...]:
    notes: list[str] = []
    if NOTED_FOCAL < uncertain <= WORST_FOCAL:
        notes.append(
            f"the focal length is known to +-{100 * uncertain:.1f} %, better to "
            f"{100 * NOTED_FOCAL:g}: {_MORE_TILTED}"
        )
    if empty and not objections:
        notes.append(f"no picture has the board in the {_listed(empty)} of the view")
    if not fit.k3_is_told:
        notes.append("the pictures can't tell k3, so it is 0")
    if len(fit.camera.distortion) > len(NARROW):
        notes.append("five coefficients would fold its picture over, so it has eight")
    if folds_within(fit.camera):
        notes.append("the lens folds its corners over; what a policy looks at is not touched")
    view = view_deg(fit.camera)
    nominal = (PI_CAMERA_HORIZONTAL_FOV_DEG, PI_CAMERA_VERTICAL_FOV_DEG)
    if view[0] < 0.85 * nominal[0]:
        notes.append(
            f"the view is {view[0]:.1f} x {view[1]:.1f} degrees, narrower than the Pi camera's "
            f"{nominal[0]:g} x {nominal[1]:g}: if that is your camera, a cropping sensor mode was "
            "on; the robot drives with 2028 x 1520"
        )
    return tuple(notes)


def view_deg(camera: CameraModel) -> tuple[float, float]:
    """Field of view across and up, through the optical axis, as the lens shows it."""
    across, up = (
        sum(
            np.degrees(np.arctan(ray_slope(camera, away / focal)))
            for away in (principal + 0.5, size - principal - 0.5)
        )
        for size, principal, focal in (
            (camera.width_px, camera.principal_x_px, camera.focal_x_px),
            (camera.height_px, camera.principal_y_px, camera.focal_y_px),
        )
    )
    return float(across), float(up)


def _listed(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
