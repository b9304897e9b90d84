"""The plane a marker moves in, from its own pictures: it is a square of known size everywhere.

Seen in many places of a picture, a square's size and shape tell how the camera is tilted, how far
away the plane is and, as far as they matter, focal length and distortion. Nothing needs to be laid
on the floor or measured but the marker's edge.
"""

from dataclasses import dataclass

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray
from scipy.optimize import least_squares

from mbot_protocol.drive.camera_model import CameraModel
from mbot_workstation.measure.tracking.floor_plane import FloorPlane, pixel_rays
from mbot_workstation.sim.track import Array

MOST_SIGHTS = 300
"""Spread over the picture; more do not make it more exact, only slower."""

FOCAL_SPREAD, K1_SPREAD = 0.12, 0.10
"""How far an unknown webcam may be from the stated field of view and from a lens without
distortion: wide enough for most, narrow enough to hold what the pictures can't tell."""

PIXEL_NOISE = 0.3
"""Of a corner, to weigh pictures against those two."""

GOOD_PX = 0.3
"""A fit this good is the right one; from a wrong tilt it ends in something of a pixel."""

STARTS = ((0.0, 0.0), (0.3, 0.0), (-0.3, 0.0), (0.0, 0.3), (0.0, -0.3), (0.7, 0.0))
"""Tilts to begin with [rad], about the picture's horizontal and vertical axis: a camera on a shelf
looks down aslant."""


@dataclass(frozen=True, slots=True, eq=False)
class MarkerPlane:
    """What was found.

    Attributes:
        camera: with focal length and k1 as found, if they were to be found.
        plane: in which the marker moves.
        error_px: root mean square of how far corners are off.

    """

    camera: CameraModel
    plane: FloorPlane
    error_px: float


def plane_from_marker(
    camera: CameraModel, quads_px: Array, edge_m: float, *, camera_is_known: bool
) -> MarkerPlane:
    """Fit the plane, and an unknown camera with it.

    Args:
        camera: a first guess, or the calibrated one.
        quads_px: the marker's corners in n pictures, clockwise, shape (n, 4, 2).
        edge_m: of the marker.
        camera_is_known: whether the camera is to be kept as it is.

    """
    chosen = quads_px[_spread_out(quads_px)]
    fits: list[MarkerPlane] = []
    for start in STARTS:
        fits.append(_fit(camera, chosen, edge_m, start, camera_is_known))
        if fits[-1].error_px < GOOD_PX:
            break
    return min(fits, key=lambda fit: fit.error_px)


def edges_m(places_m: Array) -> Array:
    """Mean edge of each square. Shapes (n, 4, 2), (n,)."""
    sides = places_m - np.roll(places_m, 1, axis=1)
    return np.linalg.norm(sides, axis=2).mean(axis=1)


def _spread_out(quads_px: Array) -> NDArray[np.intp]:
    """Rows of at most MOST_SIGHTS pictures, chosen evenly over where the marker was seen.

    A robot that stands for minutes in one place must not outweigh all its drives.
    """
    centres = quads_px.mean(axis=1)
    low, high = centres.min(axis=0), centres.max(axis=0)
    cells = np.floor((centres - low) / np.maximum(high - low, 1) * 15.999).astype(int)
    order = np.random.default_rng(0).permutation(len(quads_px))
    counts: dict[tuple[int, int], int] = {}
    ranks = np.empty(len(quads_px), dtype=np.intp)
    for row in order:
        cell = (int(cells[row, 0]), int(cells[row, 1]))
        ranks[row] = counts[cell] = counts.get(cell, -1) + 1
    return order[np.argsort(ranks[order], kind="stable")][:MOST_SIGHTS]


def _fit(
    camera: CameraModel,
    quads_px: Array,
    edge_m: float,
    start: tuple[float, float],
    camera_is_known: bool,
) -> MarkerPlane:
    """Least squares over tilt (2), log distance, log focal length, k1."""
    sizes_px = np.linalg.norm(quads_px - np.roll(quads_px, 1, axis=1), axis=2).mean(axis=1)
    distance_m = camera.focal_x_px * edge_m / float(np.median(sizes_px))
    # A known camera's focal length and k1 stay as they are: 0.
    fixed = 2 if camera_is_known else 0

    def off_px(values: Array) -> Array:
        changed, plane = _setting(camera, values)
        off_m = _off_square_m(plane.places_m(pixel_rays(changed, quads_px)), edge_m)
        scaled = off_m * (sizes_px / edge_m)[:, None, None]
        # A tilt with which the marker would be above the horizon is merely very wrong.
        return np.nan_to_num(scaled, nan=1e3, posinf=1e3, neginf=-1e3)

    def residuals(free: Array) -> Array:
        values = np.pad(free, (0, fixed))
        held = values[3:] / [FOCAL_SPREAD, K1_SPREAD]
        return np.concatenate([_softened(off_px(values).ravel() / PIXEL_NOISE), held])

    first = np.array([*start, np.log(distance_m), 0.0, 0.0])
    found = least_squares(residuals, first[: 5 - fixed]).x
    values = np.pad(found, (0, fixed))
    error_px = np.median(np.sqrt((off_px(values) ** 2).sum(axis=2).mean(axis=1)))
    return MarkerPlane(*_setting(camera, values), float(error_px))


def _setting(camera: CameraModel, values: Array) -> tuple[CameraModel, FloorPlane]:
    about_x, about_y, log_distance, log_focal, k1 = values
    changed = camera
    if log_focal or k1:
        factor = float(np.exp(log_focal))
        changed = replace(
            camera,
            focal_x_px=camera.focal_x_px * factor,
            focal_y_px=camera.focal_y_px * factor,
            distortion=(camera.distortion[0] + float(k1), *camera.distortion[1:]),
        )
    # Looking straight down, up is -z; tilted up by `about_x`, up turns towards -y.
    up = np.array(
        [
            np.sin(about_y),
            -np.sin(about_x) * np.cos(about_y),
            -np.cos(about_x) * np.cos(about_y),
        ]
    )
    return changed, FloorPlane(up, float(np.exp(log_distance)))


def _off_square_m(places_m: Array, edge_m: float) -> Array:
    """Corners minus those of the square that fits best, moved and turned. Shape (n, 4, 2)."""
    half = edge_m / 2
    square = np.array([-half + half * 1j, half + half * 1j, half - half * 1j, -half - half * 1j])
    corners = places_m[..., 0] + 1j * places_m[..., 1]
    centred = corners - corners.mean(axis=1, keepdims=True)
    turn = centred @ square.conj()
    with np.errstate(invalid="ignore"):  # above the horizon
        turn = turn / np.maximum(np.abs(turn), 1e-12)
    off = centred - turn[:, None] * square
    return np.stack([off.real, off.imag], axis=2)


def _softened(values: Array) -> Array:
    """Residuals beyond 3 sigma count as their square root: a few wrong corners must not pull."""
    size = np.abs(values)
    return np.where(size > 3, np.sign(values) * np.sqrt(np.maximum(6 * size - 9, 0)), values)
