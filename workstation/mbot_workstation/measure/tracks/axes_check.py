"""Are up axis and quaternion order what they are declared to be? A robot stays level."""

from collections.abc import Sequence
from dataclasses import dataclass

import msgspec
import numpy as np

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.measure.tracks.motion import DrivenRun
from mbot_workstation.measure.tracks.raw_track import to_file_frame, to_our_frame
from mbot_workstation.measure.tracks.track import Array, Track
from mbot_workstation.measure.tracks.track_format import TrackFormat

LARGEST_TILT_DEG = 15.0
"""Away from the mean, which is how the tracker is mounted. A robot on the floor tilts by 2."""

LARGEST_RISE_M = 0.08
LARGEST_SLOPE = 0.05
"""Of the height over a run: a tracker's floor may be out of level by 3 degrees, and noise."""

UPSIDE_DOWN_MISFIT = 30.0
FAR_BETTER = 3.0
CLEAR_DEG = 3.0
"""Another declaration is named if its misfit is below a third of the declared one's, and that by
more than a robot rocks on its caster (2 degrees)."""

MOST_POSES = 500
"""Of each run; evenly chosen. More would only take longer."""


@dataclass(frozen=True, slots=True)
class _Level:
    """How level a robot stays.

    Attributes:
        tilt_deg: away from how it is mostly; 95th percentile.
        mount_deg: between the tracker's own up and the world's.
        excess_m: rise beyond what is allowed.

    """

    tilt_deg: float
    mount_deg: float
    excess_m: float

    @property
    def is_fine(self) -> bool:
        return self.tilt_deg <= LARGEST_TILT_DEG and self.excess_m <= 0

    @property
    def misfit(self) -> float:
        """In degrees of tilt. Nobody mounts a tracker upside down, but see `check_frame`."""
        upside_down = UPSIDE_DOWN_MISFIT if self.mount_deg > 90 else 0.0
        return self.tilt_deg + upside_down + 100 * max(0.0, self.excess_m)


def check_frame(runs: Sequence[DrivenRun], declared: TrackFormat) -> None:
    """Find a wrong up axis or quaternion order.

    A wrong order mostly shows as a tilt that changes while the robot turns. In a frame with y up,
    though, it nearly equals a tracker mounted upside down; so that which fits far better is named
    also where the declared one might pass.

    Raises:
        ConfigurationError: as declared, the robot would leave the floor or tip over; with the
            declaration that fits, if one does.

    """
    tracks = [_thinned(run.run.track) for run in runs]
    level = _level(tracks)
    others = [
        (_level([_as_if(track, declared, other) for track in tracks]), other)
        for other in _others(declared)
    ]
    for best, other in sorted(others, key=lambda pair: pair[0].misfit)[:1]:
        far_better = FAR_BETTER * best.misfit + CLEAR_DEG < level.misfit
        if best.is_fine and (far_better or not level.is_fine):
            raise ConfigurationError(_named(level, declared, other))
    if level.is_fine:
        return
    if level.excess_m > 0:
        worst = max(runs, key=lambda run: _rise_m(run.run.track))
        steady = _steady_axis([_as_file(run.run.track, declared) for run in runs])
        raise ConfigurationError(
            f'with up = "{declared.up}" the height changes by '
            f"{_rise_m(worst.run.track):.2f} m in {worst.name}, expected a robot on the floor; "
            f"the steadiest axis is {steady}, but the attitudes do not fit that; are the columns "
            "right?"
        )
    raise ConfigurationError(
        f"the tracker tilts by {level.tilt_deg:.0f} degrees while the robot drives on the floor, "
        "and no other up axis or quaternion order mends that; are these the quaternion's columns, "
        "and is the tracker firmly mounted?"
    )


def _named(level: _Level, declared: TrackFormat, other: TrackFormat) -> str:
    keys: list[str] = []
    found: list[str] = []
    if other.up != declared.up:
        keys.append(f'up = "{other.up}"')
        found.append(
            f"axis {other.up} of the tracker's frame is the one that points up (or down: "
            f'"-{other.up}"), not {declared.up}'
        )
    if other.quaternion_order != declared.quaternion_order:
        keys.append(f'quaternion_order = "{other.quaternion_order}"')
        found.append(f"the quaternions are {other.quaternion_order}")
    symptoms = [f"tilts by {level.tilt_deg:.0f} degrees"]
    if level.mount_deg > 90:
        symptoms.append("carries the tracker upside down")
    if level.excess_m > 0:
        symptoms.append(f"leaves the floor by {level.excess_m:.2f} m")
    return (
        f"as declared, the robot {' and '.join(symptoms)}; it stays level if "
        f"{' and '.join(found)}: set {' and '.join(keys)} in track.toml"
    )


def _others(declared: TrackFormat) -> list[TrackFormat]:
    """Other declarations, the likely ones first. Whether up points down, nothing level shows."""
    orders = [declared.quaternion_order]
    if declared.quaternion is not None:
        orders.append("w-last" if declared.quaternion_order == "w-first" else "w-first")
    axes = [declared.up]
    if len(declared.position) == 3:
        axes += [axis for axis in ("z", "y", "x") if axis not in declared.up]
    return [
        msgspec.structs.replace(declared, up=axis, quaternion_order=order)
        for axis in axes
        for order in orders
    ][1:]


def _as_file(track: Track, declared: TrackFormat) -> Track:
    position, quaternion = to_file_frame(
        track.position_m, track.quaternion_wxyz, declared.up, declared.handedness
    )
    return Track(track.time_s, position, quaternion)


def _as_if(track: Track, declared: TrackFormat, other: TrackFormat) -> Track:
    """The track as it would be if the file were declared otherwise."""
    raw = _as_file(track, declared)
    quaternion = raw.quaternion_wxyz
    if other.quaternion_order != declared.quaternion_order:
        # Read as w-first, w-last columns x y z w were taken for w x y z: turn them by one.
        quaternion = np.roll(quaternion, 1 if other.quaternion_order == "w-last" else -1, axis=1)
    position, quaternion = to_our_frame(raw.position_m, quaternion, other.up, other.handedness)
    return Track(track.time_s, position, quaternion)


def _level(tracks: Sequence[Track]) -> _Level:
    ups = np.concatenate([track.up_in_tracker for track in tracks])
    mean = np.median(ups, axis=0)
    mean /= max(float(np.linalg.norm(mean)), 1e-9)
    angles_deg = np.degrees(np.arccos(np.clip(ups @ mean, -1, 1)))
    return _Level(
        tilt_deg=float(np.quantile(angles_deg, 0.95)),
        mount_deg=float(np.degrees(np.arccos(np.clip(mean[2], -1, 1)))),
        excess_m=max(map(_excess_m, tracks)),
    )


def _excess_m(track: Track) -> float:
    extent_m = float(np.linalg.norm(_extents_m(track)[:2]))
    return _rise_m(track) - LARGEST_RISE_M - LARGEST_SLOPE * extent_m


def _rise_m(track: Track) -> float:
    return float(_extents_m(track)[2])


def _extents_m(track: Track) -> Array:
    low, high = np.quantile(track.position_m, (0.05, 0.95), axis=0)
    return high - low


def _steady_axis(tracks: Sequence[Track]) -> str:
    extents = np.max([_extents_m(track) for track in tracks], axis=0)
    return "xyz"[int(np.argmin(extents))]


def _thinned(track: Track) -> Track:
    step = max(1, len(track) // MOST_POSES)
    return Track(track.time_s[::step], track.position_m[::step], track.quaternion_wxyz[::step])
