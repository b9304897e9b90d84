"""From a marker's corners in pictures to a track on the floor."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbot_protocol.drive.camera_model import CameraModel
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.measure.tracking.floor_plane import FloorPlane, pixel_rays
from mbot_workstation.measure.tracking.plane_from_marker import (
    MarkerPlane,
    edges_m,
    plane_from_marker,
)
from mbot_workstation.sim.track import Array, Track

FEWEST_SIGHTS = 20

LARGEST_EDGE_ERROR = 0.06
"""Of a marker measured in the picture against the declared one: a ruler and a floor's distances
are better than that, an edge mistaken for the white margin's is 33 % off."""

SMALLEST_EDGE_PX = 12.0
"""Two pixels a cell; below, the marker is found in some frames and its yaw is noise."""


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
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
    sights: Sequence[Sight],
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
