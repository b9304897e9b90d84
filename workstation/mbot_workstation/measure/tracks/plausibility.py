"""Can a robot have driven this? Every check a recording must pass before anything is fitted."""

from collections.abc import Sequence
from pathlib import Path

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.measure.tracks.axes_check import check_frame
from mbot_workstation.measure.tracks.direction_check import check_directions
from mbot_workstation.measure.tracks.driven_run import DrivenRun
from mbot_workstation.measure.tracks.maneuver import maneuver_named
from mbot_workstation.measure.tracks.run import Run
from mbot_workstation.measure.tracks.run_check import check_repeated_numbers, check_run
from mbot_workstation.measure.tracks.track_format import TrackFormat
from mbot_workstation.measure.tracks.unit_check import check_units


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
