"""Can a robot have driven this? Every check a recording must pass before anything is fitted."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.measure.tracks.axes_check import check_frame
from mbot_workstation.measure.tracks.direction_check import check_directions
from mbot_workstation.measure.tracks.maneuver import maneuver_named
from mbot_workstation.measure.tracks.motion import DrivenRun
from mbot_workstation.measure.tracks.run import Run, UnusableRunError
from mbot_workstation.measure.tracks.track import Track
from mbot_workstation.measure.tracks.track_cleaning import clean
from mbot_workstation.measure.tracks.track_format import TrackFormat
from mbot_workstation.measure.tracks.unit_check import check_units

LONGEST_GAP_S = 0.4
"""While it drives. At a spin's 7 rad/s the yaw is ambiguous after 0.45 s."""

LARGEST_OUTLIER_SHARE = 0.2

SLACK_S = 0.3
"""Of latency, and of a start or an end hidden in noise."""

SHORTEST_SHARE = 0.85
"""Of the commanded time during which it must have moved."""


def check_run(run: DrivenRun) -> None:
    """Find a run that is not whole.

    Raises:
        UnusableRunError: with the run and the reason.

    """
    commands, track = run.run.commands, run.run.track
    told_s = commands.end_s - commands.start_s
    number = run.run.number
    if track.duration_s < told_s - SLACK_S:
        raise UnusableRunError.of(
            number,
            f"{run.name} was cut short: its track is {track.duration_s:.1f} s long, the robot was "
            f"told to drive for {told_s:.1f}",
        )
    moving_s = run.moving_s
    if moving_s is None:
        raise UnusableRunError.of(number, f"{run.name}: the robot never moves")
    moved_s = moving_s[1] - moving_s[0]
    if moved_s < SHORTEST_SHARE * told_s - SLACK_S:
        begins = moving_s[0] - track.time_s[0] < SLACK_S
        ends = track.time_s[-1] - moving_s[1] < SLACK_S
        where = (
            "it drives already when the track begins"
            if begins
            else "it still drives when the track ends"
            if ends
            else "it starts and stops within the track"
        )
        raise UnusableRunError.of(
            number,
            f"{run.name} was cut short: the robot moves for {moved_s:.1f} s of the commanded "
            f"{told_s:.1f}, and {where}",
        )
    _check_quality(run, moving_s)


def check_repeated_numbers(runs: Sequence[DrivenRun]) -> None:
    """Find two runs that claim to be the same repetition.

    Raises:
        ConfigurationError: with both.

    """
    seen: dict[tuple[str, int], DrivenRun] = {}
    for run in runs:
        key = (run.run.maneuver, run.run.repetition)
        if key in seen:
            raise ConfigurationError(
                f"runs {seen[key].run.number} and {run.run.number} are both {key[0]}, repetition "
                f"{key[1]}; number the repetitions from 1, and remove spoilt runs"
            )
        seen[key] = run


def _check_quality(run: DrivenRun, moving_s: tuple[float, float]) -> None:
    track = run.run.track
    kept, quality = clean(track)
    share = (quality.outliers + quality.frozen) / len(track)
    if share > LARGEST_OUTLIER_SHARE:
        raise UnusableRunError.of(
            run.run.number,
            f"{run.name}: {share:.0%} of its poses are jumps or repeats, as of a tracker that has "
            "lost its base stations",
        )
    gap_s, at_s = _longest_gap(kept, *moving_s)
    if gap_s > LONGEST_GAP_S:
        raise UnusableRunError.of(
            run.run.number,
            f"{run.name}: the tracker was lost for {gap_s:.1f} s, {at_s - track.time_s[0]:.1f} s "
            "after the track's start",
        )


def _longest_gap(track: Track, first_s: float, last_s: float) -> tuple[float, float]:
    """The longest gap that reaches into this time, and when it begins."""
    starts, ends = track.time_s[:-1], track.time_s[1:]
    inside = (ends > first_s) & (starts < last_s)
    if not inside.any():
        return 0.0, 0.0
    gaps = np.where(inside, ends - starts, 0.0)
    longest = int(np.argmax(gaps))
    return float(gaps[longest]), float(starts[longest])


def check_runs(folder: Path, runs: Sequence[Run], form: TrackFormat) -> None:
    """Units, axes, completeness, directions, in the order in which one can hide the next.

    Args:
        folder: for messages.
        runs: at least one.
        form: as their tracks were declared.

    Raises:
        ConfigurationError: the first thing that can't be.

    """
    # A slow run stands for half its time: what it shows is left to the fit.
    driven = [DrivenRun.of(run) for run in runs if not maneuver_named(run.maneuver).is_slow]
    try:
        if not driven:
            raise ConfigurationError(
                "it holds slow runs only; drive some of the eight maneuvers at full speed too"
            )
        check_repeated_numbers(driven)
        check_units(driven, form.position_unit)
        check_frame(driven, form)
        for run in driven:
            check_run(run)
        check_directions(driven)
    except ConfigurationError as error:
        raise error.within(folder) from None
