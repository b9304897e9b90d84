"""What trackers do wrong, found and left out: spikes, reflections, frozen and lost poses.

Nothing is smoothed or filled in: poses are kept as they are or left out.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbot_workstation.measure.tracks.track import Array, Track, running_windows, without_sign_flips

Mask = NDArray[np.bool_]

MAD_TO_SIGMA = 1.4826
"""Median absolute deviation to standard deviation of a normal distribution."""

SPIKE_SIGMAS = 6.0
"""In 72,000 poses of 4 mm noise not one is this far off by chance."""

FEWEST_POSITION_M = 0.005
FEWEST_ANGLE_RAD = 0.02
"""Nearer than this to its neighbours no pose is a spike, even of a tracker without noise: at
0.45 m/s and 8 rad/s the neighbours' median is off by less."""

SPIKE_WINDOW_S = 0.06
"""To each side. A drive's path is nearly straight over 0.12 s, so the median is its middle."""

REFLECTION_WINDOW_S = 0.25
REFLECTION_POSITION_M = 0.12
"""A reflection throws the pose off for several samples, but by a lot. A tracker 5 cm off the
robot's centre stays within 5 cm of the median over half a second of spinning."""

FROZEN_POSES = 3
"""So many equal poses in a row, and then a jump: the tracker was lost and repeated itself."""


@dataclass(frozen=True, slots=True)
class TrackQuality:
    """How good a track is.

    Attributes:
        rate_hz: poses a second, from the steps that are not gaps.
        jitter_s: standard deviation of the steps that are not gaps (robust).
        lost_share: of the poses that this rate would have given in the same time.
        longest_gap_s: between two poses that are used.
        outliers: poses left out because they are far from their neighbours.
        frozen: poses left out because they repeat one from before the tracker was lost.
        position_noise_m: standard deviation of one coordinate, from pose to pose; slow drift
            and what the tracker has smoothed away do not show.
        angle_noise_rad: likewise, about one axis.

    """

    rate_hz: float
    jitter_s: float
    lost_share: float
    longest_gap_s: float
    outliers: int
    frozen: int
    position_noise_m: float
    angle_noise_rad: float


def clean(track: Track) -> tuple[Track, TrackQuality]:
    """The track without frozen poses and outliers, and how good it is.

    Raises:
        ValueError: fewer than 2 poses are left.

    """
    frozen = frozen_poses(track)
    thawed = track.where(~frozen)
    outliers = outlying_poses(thawed)
    kept = thawed.where(~outliers)
    position_m, angle_rad = noise(kept)
    steps_s = np.diff(kept.time_s)
    step_s = float(np.median(steps_s))
    regular = steps_s[steps_s < 1.75 * step_s]
    step_s = float(np.mean(regular))
    spread_s = MAD_TO_SIGMA * float(np.median(np.abs(regular - np.median(regular))))
    quality = TrackQuality(
        rate_hz=1 / step_s,
        jitter_s=spread_s,
        lost_share=max(0.0, 1 - len(kept) * step_s / (kept.duration_s + step_s)),
        longest_gap_s=float(steps_s.max()),
        outliers=int(np.count_nonzero(outliers)),
        frozen=int(np.count_nonzero(frozen)),
        position_noise_m=position_m,
        angle_noise_rad=angle_rad,
    )
    return kept, quality


def noise(track: Track) -> tuple[float, float]:
    """Standard deviations of one coordinate [m] and of the attitude about one axis [rad].

    From how far each pose is off the line between its two neighbours, so that motion cancels.
    """
    if len(track) < 3:
        return 0.0, 0.0
    before, after, share = _neighbours(track.time_s)
    gain = np.sqrt(1 + share**2 + (1 - share) ** 2)
    line = _between(track.position_m[before], track.position_m[after], share)
    off_m = (track.position_m[1:-1] - line) / gain[:, None]
    attitude = without_sign_flips(track.quaternion_wxyz)
    middle = _between(attitude[before], attitude[after], share)
    # A small rotation of angle a differs from none by a / 2 in three of the four components.
    off_rad = 2 * (attitude[1:-1] - _unit(middle)) / gain[:, None]
    spread_rad = _sigma(np.linalg.norm(off_rad, axis=1))
    return float(np.sqrt(np.mean(_sigmas(off_m) ** 2))), spread_rad


def outlying_poses(track: Track) -> Mask:
    """Which poses are far from the median of those around them. Shape (n,). Never the first and the
    last: they may just be on the move.
    """
    far = _off_median_m(track.time_s, track.position_m, REFLECTION_WINDOW_S)
    wild = far > REFLECTION_POSITION_M
    near = ~wild
    if np.count_nonzero(near) < 3:
        return wild
    rest = track.where(near)
    position_m, angle_rad = noise(rest)
    off_m = _off_median_m(rest.time_s, rest.position_m, SPIKE_WINDOW_S)
    off_rad = _off_median_rad(rest.time_s, rest.quaternion_wxyz, SPIKE_WINDOW_S)
    spikes = off_m > max(SPIKE_SIGMAS * position_m, FEWEST_POSITION_M)
    spikes |= off_rad > max(SPIKE_SIGMAS * angle_rad, FEWEST_ANGLE_RAD)
    result = wild.copy()
    result[near] = spikes
    return result


def frozen_poses(track: Track) -> Mask:
    """Which poses repeat the one before, up to a jump that shows the tracker was lost. Shape (n,).

    A robot that stands also repeats its pose, if the tracker has no noise; it then moves off
    without a jump.
    """
    table = np.concatenate([track.position_m, track.quaternion_wxyz], axis=1)
    same = np.concatenate([[False], (np.diff(table, axis=0) == 0).all(axis=1)])
    frozen = np.zeros(len(track), dtype=np.bool_)
    row = 1
    while row < len(track):
        if not same[row]:
            row += 1
            continue
        first = row
        while row < len(track) and same[row]:
            row += 1
        if row == len(track) or row - first < FROZEN_POSES - 1:
            continue
        jump_m = float(np.linalg.norm(track.position_m[row] - track.position_m[row - 1]))
        if jump_m > 2 * FEWEST_POSITION_M:
            frozen[first:row] = True
    return frozen


def _neighbours(time_s: Array) -> tuple[NDArray[np.intp], NDArray[np.intp], Array]:
    """Rows before and after each inner row, and where between them it is, 0 to 1."""
    rows = np.arange(1, len(time_s) - 1)
    share = (time_s[1:-1] - time_s[:-2]) / (time_s[2:] - time_s[:-2])
    return rows - 1, rows + 1, share


def _between(first: Array, second: Array, share: Array) -> Array:
    return first + share[:, None] * (second - first)


def _unit(quaternions: Array) -> Array:
    # Opposite attitudes may have a median of 0, which is far from all of them.
    return quaternions / np.maximum(np.linalg.norm(quaternions, axis=1, keepdims=True), 1e-9)


def _off_median_m(time_s: Array, position_m: Array, window_s: float) -> Array:
    """How far each row is from the median of the rows within `window_s`. Shape (n,)."""
    medians = np.median(running_windows(position_m, _reach(time_s, window_s)), axis=-1)
    return np.linalg.norm(position_m - medians, axis=1)


def _off_median_rad(time_s: Array, quaternion: Array, window_s: float) -> Array:
    """Likewise, as an angle. Each window takes its signs from its middle row, since one wild
    attitude may turn the signs of all that follow it.
    """
    windows = running_windows(without_sign_flips(quaternion), _reach(time_s, window_s))
    signs = np.where(np.einsum("ijk,ij->ik", windows, quaternion) < 0, -1.0, 1.0)
    medians = _unit(np.median(windows * signs[:, None, :], axis=-1))
    cosines = np.clip(np.abs(np.sum(medians * quaternion, axis=1)), 0, 1)
    return 2 * np.arccos(cosines)


def _reach(time_s: Array, window_s: float) -> int:
    """So many rows are about `window_s`."""
    reach = round(window_s / float(np.median(np.diff(time_s))))
    return min(max(1, reach), len(time_s) - 1)


def _sigma(values: Array) -> float:
    """Of one of three equal axes, from lengths of 3-vectors: their median is 1.538 sigma."""
    return float(np.median(values)) / 1.538


def _sigmas(columns: Array) -> Array:
    return MAD_TO_SIGMA * np.median(np.abs(columns), axis=0)
