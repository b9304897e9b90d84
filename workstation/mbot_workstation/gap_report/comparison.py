"""From recordings to held-out runs, each beside two simulated ones in the same frame and clock."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbot_workstation.calibration_files.calibration_folder import CalibrationFiles
from mbot_workstation.gap_report.body_path import Setting, body_path
from mbot_workstation.gap_report.compared_run import ComparedRun
from mbot_workstation.identification.held_out import is_held_out
from mbot_workstation.identification.mixed_fit import MixedFit, begin
from mbot_workstation.identification.preparation import prepare
from mbot_workstation.identification.run_view import RunView, simulate_views
from mbot_workstation.identification.stray_runs import stray_runs
from mbot_workstation.recordings.run import Recording
from mbot_workstation.recordings.track import Array
from mbot_workstation.simulation.robot_parameters import RobotParameters
from mbot_workstation.simulation.timestep import TIMESTEP_S

GRID_S = 0.02
"""Between the moments compared."""

ROUNDS = 8
"""Clock and tracker settle within as many: the robot is not fitted."""


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
    prepared = prepare(recordings, files.robot)
    # Without identified motors, those of the first guess are nearer than the nominal ones.
    robot = prepared.robot if files.motion is None else files.robot
    away = is_held_out(prepared.views)
    fitted = [view for view, out in zip(prepared.views, away, strict=True) if not out]
    shown = [view for view, out in zip(prepared.views, away, strict=True) if out]
    words = "Every other repetition of each manoeuvre: those that were not fitted."
    if files.motion is None or not shown:
        shown = list(prepared.views)
        words = "All runs: nothing was fitted to them."
        if files.motion is not None:
            words = "All runs: none was repeated, so none could be held out of the fit."
    fit = MixedFit(fitted, prepared.fixed, begin(fitted, robot, prepared.fixed.guess))
    fit.run((), ROUNDS)
    settings = fit.state.settings
    left_out = dict(prepared.left_out)
    if files.motion is not None:
        # As `identify` does: a run with a blocked wheel or a hand on the robot is no measurement.
        stray = stray_runs(fit, shown)
        numbered = list(enumerate(shown, start=len(fitted)))
        if any(number not in stray for number, _view in numbered):
            shown = [view for number, view in numbered if number not in stray]
            left_out |= {view.flat.name: stray[n] for n, view in numbered if n in stray}
    first = min(prepared.views, key=lambda view: view.flat.run.commands.start_s)
    compared = _compared([*shown, first], recordings, settings, files.robot)
    return Comparison(
        tuple(compared[:-1]),
        compared[-1] if first.flat.run.number == recordings[0].runs[0].number else None,
        words,
        left_out,
    )


def _compared(
    views: Sequence[RunView],
    recordings: Sequence[Recording],
    settings: Array,
    calibrated: RobotParameters,
) -> list[ComparedRun]:
    calm = [np.zeros(view.deviations) for view in views]
    paths = [
        simulate_views(views, [robot] * len(views), calm)
        for robot in (calibrated, RobotParameters())
    ]
    middles_s = [
        float(np.mean([run.commands.start_s for run in recording.runs])) for recording in recordings
    ]
    return [
        _beside(
            view,
            _setting(settings[view.flat.recording]),
            view.flat.run.commands.start_s - middles_s[view.flat.recording],
            mine,
            nominal,
        )
        for view, mine, nominal in zip(views, *paths, strict=True)
    ]


def _setting(values: Array) -> Setting:
    """In the order of `run_view.SETTING`."""
    ahead_s, drift, ahead_m, left_m, yaw_rad = (float(value) for value in values)
    return Setting(ahead_s, drift, complex(ahead_m, left_m), yaw_rad)


def _beside(
    view: RunView, setting: Setting, since_middle_s: float, calibrated: Array, nominal: Array
) -> ComparedRun:
    run = view.flat.run
    # The track may end before the drive does, by a little: see `preparation.LEAST_COVERED`.
    tracked_s = float(view.flat.time_s[-1]) - view.ahead_s - run.commands.start_s
    until_s = min(view.drive_s, tracked_s)
    time_s = np.linspace(0, until_s, max(2, round(until_s / GRID_S) + 1))
    measured = body_path(view, setting, since_middle_s, time_s)
    simulated = [_at(path, time_s) for path in (calibrated, nominal)]
    return ComparedRun(
        run.number, run.maneuver, run.repetition, view.drive_s, time_s, measured, *simulated
    )


def _at(path: Array, time_s: Array) -> Array:
    """A simulated path at these moments. Shape (n, 3)."""
    grid_s = TIMESTEP_S * np.arange(len(path))
    return np.stack([np.interp(time_s, grid_s, column) for column in path.T], axis=1)
