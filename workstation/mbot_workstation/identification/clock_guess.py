"""How far the tracker's clock is ahead of the robot's, by when the robot begins to move."""

from collections.abc import Sequence

import numpy as np

from mbot_workstation.identification.flat_track import FlatRun
from mbot_workstation.identification.steady_motion import onset_s
from mbot_workstation.recordings.track import Array
from mbot_workstation.simulation.robot_parameters import RobotParameters

STRAY_S = 0.5
"""A run that begins to move this much earlier or later than the others was not driven as told."""

SHOWING_S = 0.05
"""To move by 20 mm or 4 degrees takes this long, and 0.8 time constants."""


def guess_clocks(
    runs: Sequence[FlatRun], robot: RobotParameters, tracker_ahead_s: float | None
) -> tuple[Array, dict[int, str]]:
    """Guess for each run.

    Args:
        runs: of one recording.
        robot: for its time constants.
        tracker_ahead_s: as the recording has it; None if each run has a clock of its own.

    Returns:
        The tracker's clock minus the robot's, with the wheels' delay in it, to 0.1 s, shape
        (runs,); and which runs can't be used, by index, and why.

    """
    times_s = robot.left_motor.time_constant_s + robot.right_motor.time_constant_s
    reaction_s = SHOWING_S + 0.4 * times_s
    onsets = [onset_s(run) for run in runs]
    begun = np.array([np.nan if onset is None else onset for onset in onsets])
    ahead = begun - np.array([run.run.commands.start_s for run in runs]) - reaction_s
    known = np.isfinite(ahead)
    if tracker_ahead_s is None:
        why = "its track does not begin before the robot moves, so its clock can't be told"
        return np.where(known, ahead, 0.0), {int(i): why for i in np.flatnonzero(~known)}
    usual = float(np.median(ahead[known])) if known.any() else tracker_ahead_s
    off = np.where(known, ahead - usual, 0.0)
    stray = {
        int(i): f"it begins to move {off[i]:+.1f} s from where its commands put that"
        for i in np.flatnonzero(np.abs(off) > STRAY_S)
    }
    return np.full(len(runs), usual), stray
