"""Are positions in the unit they are declared in? A robot's speed tells."""

import math
from collections.abc import Sequence

import numpy as np

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.measure.tracks.motion import DrivenRun, numbers_of
from mbot_workstation.measure.tracks.track_cleaning import noise
from mbot_workstation.measure.tracks.track_format import METRES
from mbot_workstation.sim.body.robot_parameters import RobotParameters

USUAL_MPS = 0.4
"""120 rpm on wheels of 32.5 mm, less the load."""

STRAIGHT_MPS = (0.10, 1.0)
"""Both motors at half strength give 0.2; the maker's 200 rpm at 6 V give 0.68."""

FASTEST_MPS = 2.0
"""Of a tracker 20 cm off the middle of a robot that spins at 8 rad/s, with some to spare."""

FAST_SHARE = 0.05
"""Spikes make up less of a track than this; another unit more."""

NOISE_RATIO = 10.0
"""A tracker's noise does not grow tenfold within seconds; from metres to cm or mm it does."""

WHEELS_APART_M = (0.06, 0.25)
"""An mBot's are 0.115 m apart; slip while spinning makes it look like more."""

FIT_FACTOR = 1.7
"""A unit fits if the speed is within this factor of the usual one."""


def check_units(runs: Sequence[DrivenRun], declared: str) -> None:
    """Find positions of another unit than declared, in all runs or some.

    Args:
        runs: as read.
        declared: the unit of `position_unit`.

    Raises:
        ConfigurationError: no robot drives like that; with the unit that fits, if one does.

    """
    wrong = [run for run in runs if _is_wrong(run)]
    if wrong:
        raise ConfigurationError(_message(runs, wrong, declared))
    apart_m = _wheels_apart_m(runs)
    usual_m, (low, high) = RobotParameters().track_m, WHEELS_APART_M
    if apart_m is not None and not low <= apart_m <= high:
        unit = _unit_that_fits(declared, usual_m / apart_m)
        raise ConfigurationError(
            f"speeds and turn rates together mean wheels {apart_m:.3f} m apart, expected about "
            f"{usual_m:g}: positions declared in {declared} {_advice(unit)}"
        )


def _is_wrong(run: DrivenRun) -> bool:
    if _fast_share(run) > FAST_SHARE:
        return True
    low, high = STRAIGHT_MPS
    return run.straight and not low <= run.pace_mps <= high


def _fast_share(run: DrivenRun) -> float:
    return float(np.mean(run.motion.speed_mps > FASTEST_MPS))


def _changes_half_way(run: DrivenRun) -> bool:
    """Whether the beginning and the end of a track differ in scale: in noise, or in time driven."""
    commands, track = run.run.commands, run.run.track
    told_share = (commands.end_s - commands.start_s) / track.duration_s
    if _fast_share(run) < 0.75 * told_share:
        return True
    third = len(track) // 3
    ends = np.arange(len(track)) < third, np.arange(len(track)) >= len(track) - third
    levels_m = sorted(noise(track.where(end))[0] for end in ends)
    return levels_m[1] > NOISE_RATIO * levels_m[0] > 0


def _message(runs: Sequence[DrivenRun], wrong: Sequence[DrivenRun], declared: str) -> str:
    # A straight run says most; of the others only that they are too fast.
    first = next((run for run in wrong if run.straight), wrong[0])
    fast = first.motion.speed_mps > FASTEST_MPS
    pace_mps = float(np.median(first.motion.speed_mps[fast])) if fast.any() else first.pace_mps
    unit = _unit_that_fits(declared, USUAL_MPS / pace_mps if pace_mps > 0 else math.inf)
    speed = f"{pace_mps:.3g} m/s, expected about {USUAL_MPS}"
    if _fast_share(first) > FAST_SHARE and _changes_half_way(first):
        since_s = first.motion.time_s[int(np.argmax(fast))]
        return (
            f"{first.name} moves at {speed}, but only part of the time, first at {since_s:.2f} s "
            f"of its track: the positions {_in_unit(unit)} there and in {declared} elsewhere; "
            "convert the file to one unit"
        )
    alike = [run for run in runs if run.straight == first.straight]
    if len([run for run in wrong if run in alike]) < len(alike):
        cause = "its file is" if unit else "the robot was stuck or carried, or its file is"
        other = f"in {unit}" if unit else "in another unit"
        return (
            f"{numbers_of(wrong)} and the others differ: {first.name} moves at {speed}; {cause} "
            f"{other}, not in {declared}: convert all to one unit, or leave it out in "
            "recording.toml"
        )
    stuck = "" if pace_mps > STRAIGHT_MPS[1] else " (or the robot did not drive)"
    return f"{first.name} moves at {speed}: positions declared in {declared} {_advice(unit)}{stuck}"


def _advice(unit: str | None) -> str:
    if unit is None:
        return "fit no unit that is known here; are these the right columns?"
    return f'fit {unit}: set position_unit = "{unit}" in track.toml'


def _in_unit(unit: str | None) -> str:
    return f"seem to be in {unit}" if unit else "are in another unit or wrong"


def _unit_that_fits(declared: str, wanted: float) -> str | None:
    """The unit whose ratio to the declared one is nearest to `wanted`, if any is near."""
    misfits = {
        unit: abs(math.log(METRES[unit] / METRES[declared] / wanted)) if 0 < wanted < 1e9 else 99.0
        for unit in METRES
        if unit != declared
    }
    best = min(misfits, key=lambda unit: misfits[unit])
    return best if misfits[best] < math.log(FIT_FACTOR) else None


def _wheels_apart_m(runs: Sequence[DrivenRun]) -> float | None:
    """From driving straight and spinning; None where either is missing."""
    straight = [run.pace_mps for run in runs if run.straight]
    spins = [run.turn_radps for run in runs if run.maneuver.left == -run.maneuver.right]
    if not straight or not spins or np.median(spins) < 0.5:
        return None
    return float(2 * np.median(straight) / np.median(spins))
