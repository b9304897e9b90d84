"""A tracked run as the path of the robot itself: clock, tracker and start taken out."""

from dataclasses import dataclass

import numpy as np

from mbot_workstation.identification.run_view import RunView
from mbot_workstation.recordings.track import Array

STANDING_S = 0.5
"""Before the first command: the path begins at the middle of these poses."""

REACH_S = 0.05
"""To each side of a moment; a straight line through the poses there is the place at the moment. A
tenth of a second of 90 Hz makes 1.3 mm of 4, and bends a robot's smallest circle by 0.3."""

FEWEST = 4
"""Poses for such a line; with fewer the moment lies in a gap, which is bridged."""


@dataclass(frozen=True, slots=True)
class Setting:
    """What differs between a recording's tracker and the robot; from the fit.

    Attributes:
        ahead_s: the tracker's clock minus the robot's, beyond the first guess.
        drift: how much faster the tracker's clock is.
        tracker: its place on the robot [m], x + iy ahead and to the left of the axle's centre.
        tracker_yaw_rad: how far it is turned to the left on the robot.

    """

    ahead_s: float
    drift: float
    tracker: complex
    tracker_yaw_rad: float


def body_path(view: RunView, setting: Setting, since_middle_s: float, time_s: Array) -> Array:
    """Where the axle's centre was, from where it stood before the drive.

    Args:
        view: the run.
        setting: of its recording.
        since_middle_s: when the run began, from the recording's middle; for the drift.
        time_s: since the first command took effect, shape (n,).

    Returns:
        x, y, yaw; shape (n, 3).

    """
    flat = view.flat
    started_s = view.ahead_s + flat.run.commands.start_s + setting.ahead_s
    seen_s = flat.time_s - started_s - setting.drift * since_middle_s
    heading = flat.heading - setting.tracker_yaw_rad
    axle = flat.place - np.exp(1j * heading) * setting.tracker
    stands = (seen_s >= -STANDING_S) & (seen_s <= 0)
    if not stands.any():
        stands = seen_s == seen_s[np.argmin(np.abs(seen_s))]
    turn = float(np.median(heading[stands]))
    start = complex(np.median(axle.real[stands]), np.median(axle.imag[stands]))
    gone = (axle - start) * np.exp(-1j * turn)
    columns = (gone.real, gone.imag, heading - turn)
    return np.stack([_line_at(seen_s, column, time_s) for column in columns], axis=1)


def _line_at(seen_s: Array, values: Array, time_s: Array) -> Array:
    """At each moment the least-squares line through the samples within `REACH_S`."""
    first = np.searchsorted(seen_s, time_s - REACH_S)
    last = np.searchsorted(seen_s, time_s + REACH_S, side="right")
    middle_s = float(np.median(seen_s))  # near the moments, for the sums' sake
    t = seen_s - middle_s
    sums = [
        np.append(0, np.cumsum(terms)) for terms in (np.ones_like(t), t, t * t, values, t * values)
    ]
    count, st, stt, sv, stv = (one[last] - one[first] for one in sums)
    spread = stt * count - st * st
    enough = (count >= FEWEST) & (spread > 1e-9)
    safe = np.where(enough, spread, 1.0)
    slope = (stv * count - st * sv) / safe
    level = (sv - slope * st) / np.maximum(count, 1)
    line = level + slope * (time_s - middle_s)
    return np.where(enough, line, np.interp(time_s, seen_s, values))
