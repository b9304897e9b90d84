"""From a marker's corners in pictures to a track on the floor.

The marker is a square of known size everywhere: seen in many places, its size and shape tell how
the camera is tilted, how far away its plane is and, as far as they matter, focal length and
distortion. Nothing needs to be laid on the floor or measured but the edge of the marker.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray
from scipy.optimize import least_squares

from mbot_protocol.drive.camera_model import CameraModel
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.measure.tracking.floor_plane import FloorPlane, pixel_rays
from mbot_workstation.measure.tracks.track import Array, Track

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


FEWEST_SIGHTS = 20

LARGEST_EDGE_ERROR = 0.06
"""Of a marker measured in the picture against the declared one: a ruler and a floor's distances
are better than that, an edge mistaken for the white margin's is 33 % off."""

SMALLEST_EDGE_PX = 12.0
"""Two pixels a cell; below, the marker is found in some frames and its yaw is noise."""


@dataclass(frozen=True, slots=True, eq=False)
class MarkerSight:
    """The marker in one picture.

    Attributes:
        time_s: of the picture.
        corners_px: clockwise from the marker's upper left corner, shape (4, 2).

    """

    time_s: float
    corners_px: Array


@dataclass(frozen=True, slots=True, eq=False)
class OverheadTrack:
    """A track, and how well it fits.

    Attributes:
        track: of the marker's centre; x of its attitude points to the marker's upper edge.
        edge_mm: of the marker as measured with the plane found; equals the declared one where the
            plane comes from the marker itself.
        error_px: of its corners, root mean square.
        distance_m: from the camera straight down to the marker.
        tilt_deg: of the camera's optical axis against straight down.

    """

    track: Track
    edge_mm: float
    error_px: float
    distance_m: float
    tilt_deg: float


def overhead_track(
    sights: Sequence[MarkerSight],
    camera: CameraModel,
    edge_m: float,
    height_m: float,
    *,
    camera_is_known: bool,
    floor: FloorPlane | None = None,
) -> OverheadTrack:
    """Put the sights on the floor.

    Args:
        sights: in the order of time.
        camera: calibrated, or guessed from a field of view.
        edge_m: of the marker.
        height_m: of the marker above the floor.
        camera_is_known: whether it is calibrated.
        floor: as seen from the camera, if something on the floor told; otherwise the marker's
            own pictures tell.

    Raises:
        ConfigurationError: too few sights, too small a marker, or one that is of another size
            than declared.

    """
    if len(sights) < FEWEST_SIGHTS:
        raise ConfigurationError(
            f"the robot's marker is in {len(sights)} pictures only, expected at least "
            f"{FEWEST_SIGHTS}; is it the printed one, flat, whole in view, with its white margin?"
        )
    quads_px = np.stack([sight.corners_px for sight in sights])
    sizes_px = np.linalg.norm(quads_px - np.roll(quads_px, 1, axis=1), axis=2).mean(axis=1)
    if np.median(sizes_px) < SMALLEST_EDGE_PX:
        raise ConfigurationError(
            f"the marker is {np.median(sizes_px):.0f} pixels wide, expected at least "
            f"{SMALLEST_EDGE_PX:.0f}: print it larger, bring the camera nearer or raise its "
            "resolution"
        )
    if floor is None:
        found = plane_from_marker(camera, quads_px, edge_m, camera_is_known=camera_is_known)
    else:
        found = MarkerPlane(camera, floor.raised(height_m), 0.0)
    places_m = found.plane.places_m(pixel_rays(found.camera, quads_px))
    seen = np.isfinite(places_m).all(axis=(1, 2))
    edge_seen_m = float(np.median(edges_m(places_m[seen]))) if seen.any() else float("nan")
    if not abs(edge_seen_m / edge_m - 1) <= LARGEST_EDGE_ERROR:
        raise ConfigurationError(
            f"the marker measures {edge_seen_m * 1000:.1f} mm on the floor found, declared are "
            f"{edge_m * 1000:g}: check --marker-mm (the black square, without the white margin), "
            "--height-m and what lies on the floor"
        )
    times_s = np.array([sight.time_s for sight in sights])[seen]
    rising = np.concatenate([[True], np.diff(np.maximum.accumulate(times_s)) > 0])
    track = _track(times_s[rising], places_m[seen][rising], height_m)
    error_px = found.error_px or _error_px(places_m[seen], edge_m, sizes_px[seen])
    tilt_deg = float(np.degrees(np.arccos(np.clip(-found.plane.up[2], -1, 1))))
    return OverheadTrack(track, edge_seen_m * 1000, error_px, found.plane.distance_m, tilt_deg)


def _track(times_s: Array, places_m: Array, height_m: float) -> Track:
    centre = places_m.mean(axis=1)
    # The upper edge's middle minus the lower one's.
    ahead = places_m[:, 0] + places_m[:, 1] - places_m[:, 2] - places_m[:, 3]
    half = np.arctan2(ahead[:, 1], ahead[:, 0]) / 2
    zero = np.zeros_like(half)
    return Track(
        times_s,
        np.column_stack([centre, np.full(len(centre), height_m)]),
        np.column_stack([np.cos(half), zero, zero, np.sin(half)]),
    )


def _error_px(places_m: Array, edge_m: float, sizes_px: Array) -> float:
    """From how much edges differ from each other, the scale apart."""
    sides = np.linalg.norm(places_m - np.roll(places_m, 1, axis=1), axis=2)
    spread_m = np.std(sides, axis=1)
    return float(np.median(spread_m * sizes_px / edge_m))
