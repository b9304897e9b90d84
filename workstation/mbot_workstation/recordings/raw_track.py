"""Poses as a file has them, and what must hold before they are a track."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.recordings.track import Array, Track
from mbot_workstation.recordings.track_format import METRES, SECONDS, TrackFormat
from mbot_workstation.recordings.track_frame import to_our_frame

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
        """The track in our frame and units.

        Raises:
            ConfigurationError: too few poses, time that doesn't rise or is of another unit,
                values that are not finite, or quaternions that are none.

        """
        if len(self.time) < FEWEST_POSES:
            raise ConfigurationError(
                f"{self.path} holds {len(self.time)} poses, expected at least {FEWEST_POSES}"
            )
        self._check_finite()
        time_s = self.time * SECONDS[form.time_unit]
        self._check_time(time_s, form)
        quaternion = self._unit_quaternions()
        position_m, quaternion = to_our_frame(
            self.position * METRES[form.position_unit], quaternion, form.up, form.handedness
        )
        return Track(time_s, position_m, quaternion)

    def _check_finite(self) -> None:
        table = np.column_stack([self.time, self.position, self.quaternion_wxyz])
        bad = ~np.isfinite(table).all(axis=1)
        if bad.any():
            raise ConfigurationError(
                f"{self.path}, {self.places[int(np.argmax(bad))]}: a value is not finite; leave "
                "out poses of moments the tracker had lost"
            )

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
        for unit, factor in SECONDS.items():
            rate_hz = SECONDS[form.time_unit] / (step_s * factor)
            if slowest <= rate_hz <= fastest:
                raise ConfigurationError(
                    f"{self.path}: a pose every {step_s:g} s if time is in {form.time_unit}; in "
                    f'{unit} it would be {rate_hz:.0f} a second: set time_unit = "{unit}"'
                )
        raise ConfigurationError(
            f"{self.path}: a pose every {step_s:g} s, expected 2 to 2000 a second"
        )

    def _unit_quaternions(self) -> Array:
        norms = np.linalg.norm(self.quaternion_wxyz, axis=1)
        bad = np.abs(norms - 1) > UNIT_TOLERANCE
        if bad.any():
            at = int(np.argmax(bad))
            raise ConfigurationError(
                f"{self.path}, {self.places[at]}: the quaternion's length is {norms[at]:.3f}, "
                "expected 1; are these its columns?"
            )
        return self.quaternion_wxyz / norms[:, None]
