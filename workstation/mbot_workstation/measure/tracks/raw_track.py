"""Poses in a tracker's own frame and units, and what makes them a track in ours."""

import logging
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.measure.tracks.track import Array, Track
from mbot_workstation.measure.tracks.track_format import METRES, SECONDS, TrackFormat, seconds_of

# Each matrix takes the tracker's axes to ours by a proper rotation.
_TO_Z_UP: dict[str, Array] = {
    "z": np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=np.float64),
    "-z": np.array([[1, 0, 0], [0, -1, 0], [0, 0, -1]], dtype=np.float64),
    "y": np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], dtype=np.float64),
    "-y": np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]], dtype=np.float64),
    "x": np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]], dtype=np.float64),
    "-x": np.array([[0, 1, 0], [0, 0, -1], [-1, 0, 0]], dtype=np.float64),
}


def to_our_frame(
    position_m: Array, quaternion_wxyz: Array, up: str, handedness: str
) -> tuple[Array, Array]:
    """Positions (n, 3) and attitudes (n, 4) in a right-handed frame with z up.

    The tracker's own axes are renamed along with the world's, so that a tracker that lay flat in
    its frame lies flat in ours.
    """
    if handedness == "left":
        position_m, quaternion_wxyz = _mirrored(position_m, quaternion_wxyz, up)
    return _turned(position_m, quaternion_wxyz, _TO_Z_UP[up])


def to_file_frame(
    position_m: Array, quaternion_wxyz: Array, up: str, handedness: str
) -> tuple[Array, Array]:
    """The inverse of `to_our_frame`: positions, shape (n, 3), and attitudes, shape (n, 4)."""
    position_m, quaternion_wxyz = _turned(position_m, quaternion_wxyz, _TO_Z_UP[up].T)
    if handedness == "left":
        return _mirrored(position_m, quaternion_wxyz, up)
    return position_m, quaternion_wxyz


def _turned(position_m: Array, quaternion_wxyz: Array, matrix: Array) -> tuple[Array, Array]:
    vector = quaternion_wxyz[:, 1:] @ matrix.T
    return position_m @ matrix.T, np.concatenate([quaternion_wxyz[:, :1], vector], axis=1)


def _mirrored(position_m: Array, quaternion_wxyz: Array, up: str) -> tuple[Array, Array]:
    """Mirrored in a horizontal axis; any does, as the direction of x is the tracker's own.

    A rotation's axis mirrors the other way round, as M R M does.
    """
    signs = np.ones(3)
    signs[1 if up.endswith("z") else 2] = -1
    return position_m * signs, quaternion_wxyz * np.concatenate([[1], -signs])


def from_euler(angles_rad: Array, axes: str) -> Array:
    """Quaternions (n, 4), w first, from intrinsic rotations about `axes`. Angles (n, len(axes))."""
    result = Rotation.identity(len(angles_rad))
    # One by one: SciPy's own takes no axis twice in a row.
    for column, axis in enumerate(axes):
        result *= Rotation.from_euler(axis, angles_rad[:, [column]])
    return result.as_quat(scalar_first=True)


Mask = NDArray[np.bool_]

_log = logging.getLogger(__name__)

FEWEST_POSES = 10
"""Less says nothing about a drive; a second at 90 Hz has 90."""

UNIT_TOLERANCE = 0.02
"""Quaternions written with two decimals are this far from unit length."""

LONGEST_MEDIAN_STEP_S = 0.5
"""2 Hz. Rarer poses could not show a time constant of 0.1 s, and mostly mean a wrong unit."""

SHORTEST_MEDIAN_STEP_S = 0.0005
"""2000 Hz: no tracker is faster; a wrong unit makes it look so."""

USUAL_RATES_HZ = (10.0, 500.0)


@dataclass(frozen=True, slots=True, eq=False)
class RawTrack:
    """Poses in the tracker's own units and axes.

    Attributes:
        path: the file.
        places: of each pose in it, in words, for messages: "line 12".
        time: shape (n,).
        position: shape (n, 3).
        quaternion_wxyz: w first, of about unit length, shape (n, 4).

    """

    path: Path
    places: tuple[str, ...]
    time: Array
    position: Array
    quaternion_wxyz: Array

    def to_track(self, form: TrackFormat) -> Track:
        """The track in our frame and units, without poses that hold no number or no attitude.

        Raises:
            ConfigurationError: too few poses, time that doesn't rise or is of another unit, or
                quaternions that mostly are none.

        """
        whole = self._whole()
        time_s = whole.time * seconds_of(form)
        whole._check_time(time_s, form)
        norms = np.linalg.norm(whole.quaternion_wxyz, axis=1, keepdims=True)
        position_m, quaternion = to_our_frame(
            whole.position * METRES[form.position_unit],
            whole.quaternion_wxyz / norms,
            form.up,
            form.handedness,
        )
        return Track(time_s, position_m, quaternion)

    def _whole(self) -> "RawTrack":
        """Without the poses that are none, which are counted."""
        table = np.column_stack([self.time, self.position, self.quaternion_wxyz])
        known = np.asarray(np.isfinite(table).all(axis=1))
        lengths = np.linalg.norm(self.quaternion_wxyz, axis=1)
        unit = np.asarray(np.abs(lengths - 1) <= UNIT_TOLERANCE)
        if known.any() and np.count_nonzero(unit[known]) * 2 < np.count_nonzero(known):
            at = int(np.argmax(known & ~unit))
            raise ConfigurationError(
                f"{self.path}, {self.places[at]}: the quaternion's length is {lengths[at]:.3f}, "
                "expected 1, and so it is in most places; are these its columns?"
            )
        kept = known & unit
        if np.count_nonzero(kept) < FEWEST_POSES:
            raise ConfigurationError(
                f"{self.path} holds {np.count_nonzero(kept)} poses, expected at least "
                f"{FEWEST_POSES}{self._left_out(known, unit)}"
            )
        if not kept.all():
            _log.warning("%s: poses are left out%s", self.path, self._left_out(known, unit))
        return RawTrack(
            self.path,
            tuple(place for place, keep in zip(self.places, kept, strict=True) if keep),
            self.time[kept],
            self.position[kept],
            self.quaternion_wxyz[kept],
        )

    def _left_out(self, known: Mask, unit: Mask) -> str:
        """Why, how many and where, such as "; 4 of 5,328 were lost, the first in line 507"."""
        words = ""
        for bad, why in ((~known, "were lost"), (known & ~unit, "have no quaternion of length 1")):
            if bad.any():
                where = self.places[int(np.argmax(bad))]
                count = np.count_nonzero(bad)
                words += f"; {count:,} of {len(bad):,} {why}, the first in {where}"
        return words

    def _check_time(self, time_s: Array, form: TrackFormat) -> None:
        steps_s = np.diff(time_s)
        if not (steps_s > 0).all():
            at = int(np.argmax(steps_s <= 0)) + 1
            count = int(np.count_nonzero(steps_s <= 0))
            raise ConfigurationError(
                f"{self.path}, {self.places[at]}: time is {self.time[at]:.6f} after "
                f"{self.time[at - 1]:.6f}, expected to rise ({count} such places); sort the poses "
                "and leave out repeated ones"
            )
        step_s = float(np.median(steps_s))
        if SHORTEST_MEDIAN_STEP_S <= step_s <= LONGEST_MEDIAN_STEP_S:
            return
        slowest, fastest = USUAL_RATES_HZ
        if form.frames_hz is None and (np.diff(self.time) == 1).mean() > 0.5:
            raise ConfigurationError(
                f"{self.path} has no column of time: {form.time!r} counts by one, as numbers of "
                "frames do; say how many there are a second, such as frames_hz = 100 in track.toml"
            )
        for unit, factor in SECONDS.items():
            rate_hz = seconds_of(form) / (step_s * factor)
            if slowest <= rate_hz <= fastest:
                raise ConfigurationError(
                    f"{self.path}: a pose every {step_s:g} s if time is in {form.time_unit}; in "
                    f'{unit} it would be {rate_hz:.0f} a second: set time_unit = "{unit}"'
                )
        raise ConfigurationError(
            f"{self.path}: a pose every {step_s:g} s, expected 2 to 2000 a second"
        )
