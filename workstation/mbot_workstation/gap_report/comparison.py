"""From recordings to held-out runs, each beside two simulated ones in the same frame and clock."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbot_workstation.calibration_files.calibration_folder import CalibrationFiles
from mbot_workstation.gap_report.compared_run import ComparedRun
from mbot_workstation.identification.data import prepare
from mbot_workstation.identification.fit import aligned, begins_s
from mbot_workstation.identification.held_out import driven, is_held_out
from mbot_workstation.identification.increments import Observed
from mbot_workstation.identification.model import drive_plans
from mbot_workstation.identification.stray import stray_runs
from mbot_workstation.recordings.run import Recording
from mbot_workstation.recordings.track import Array
from mbot_workstation.simulation.parameter_table import with_values
from mbot_workstation.simulation.robot_parameters import RobotParameters
from mbot_workstation.simulation.timestep import TIMESTEP_S

GRID_S = 0.02
"""Between the moments compared."""

MIDDLE = 0.5
"""Of a session: how far the battery has run down in a run that one knows nothing of."""

REACH_S = 0.05
"""To each side of a moment; a straight line through the poses there is the place at the moment. A
tenth of a second of 90 Hz makes 1.3 mm of 4, and bends a robot's smallest circle by 0.3."""

FEWEST = 4
"""Poses for such a line; with fewer the moment lies in a gap, which is bridged."""


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """What driving shows.

    Attributes:
        held_out: runs that were not fitted.
        first: the session's first run, if it can be used: frames were taken in it.
        words: which runs were held out.
        left_out: runs that can't be used, by name, and why.

    """

    held_out: tuple[ComparedRun, ...]
    first: ComparedRun | None
    words: str
    left_out: dict[str, str]


def compare(recordings: Sequence[Recording], files: CalibrationFiles) -> Comparison:
    """Align every run and simulate it twice.

    Where the tracker sits and how its clock is off is found from the fitted runs alone; each run
    begins where the robot stood before it.

    Args:
        recordings: of the robot, at least one.
        files: its calibration.

    Raises:
        ConfigurationError: the recordings can't be used; the text says why.

    """
    data = prepare(recordings, files.robot)
    # Without identified motors, those of the first guess are nearer than the nominal ones.
    calibrated = files.robot.discharged(MIDDLE)
    robot = with_values(data.robot, data.guessed) if files.motion is None else calibrated
    away = np.array(is_held_out(data.runs))
    problem, solution = aligned(data, robot, np.flatnonzero(~away).tolist())
    chosen, words = away, "Every other repetition of each manoeuvre: those that were held out."
    if files.motion is None or not away.any():
        chosen, words = np.ones_like(away), "All runs: nothing was fitted to them."
        if files.motion is not None:
            words = "All runs: none was repeated, so none could be held out of the fit."
    # As `identify` does: a run with a blocked wheel or a hand on the robot is no measurement.
    stray = {} if files.motion is None else stray_runs(problem, solution)
    shown = [index for index in np.flatnonzero(chosen).tolist() if index not in stray]
    first = min(range(len(away)), key=lambda i: data.runs[i].flat.run.commands.start_s)
    # Apart: a batch takes robots of the same parts only.
    paths = [drive_plans([one], problem.plans)[0] for one in (calibrated, RobotParameters())]
    later_s, settings = begins_s(problem, solution), solution.state.settings

    def beside(index: int) -> ComparedRun:
        run = data.runs[index]
        setting, plan = settings[run.flat.recording], problem.which[index]
        return _beside(run, setting, float(later_s[index]), *(path[plan] for path in paths))

    is_first = data.runs[first].flat.run.number == recordings[0].runs[0].number
    return Comparison(
        tuple(beside(index) for index in shown),
        beside(first) if is_first else None,
        words,
        data.left_out | {data.named(data.runs[index]): why for index, why in stray.items()},
    )


def _beside(
    observed: Observed, setting: Array, later_s: float, calibrated: Array, nominal: Array
) -> ComparedRun:
    run = observed.flat.run
    axle, heading, when_s = driven(observed, setting, later_s)
    # The track may end before the drive does, by a little: see `data.LEAST_COVERED`.
    until_s = min(observed.drive_s, float(when_s[-1]))
    time_s = np.linspace(0, until_s, max(2, round(until_s / GRID_S) + 1))
    columns = (axle.real, axle.imag, heading)
    measured = np.stack([line_at(when_s, column, time_s) for column in columns], axis=1)
    simulated = [_at(path, time_s) for path in (calibrated, nominal)]
    return ComparedRun(
        run.number, run.maneuver, run.repetition, observed.drive_s, time_s, measured, *simulated
    )


def _at(path: Array, time_s: Array) -> Array:
    """A simulated path at these moments. Shape (n, 3)."""
    grid_s = TIMESTEP_S * np.arange(len(path))
    return np.stack([np.interp(time_s, grid_s, column) for column in path.T], axis=1)


def line_at(seen_s: Array, values: Array, time_s: Array) -> Array:
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
