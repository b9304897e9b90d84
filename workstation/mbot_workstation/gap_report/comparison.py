"""From recordings to held-out runs, each beside two simulated ones in the same frame and clock."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbot_workstation.calibration.folder import CalibrationFiles
from mbot_workstation.gap_report.compared_run import ComparedRun
from mbot_workstation.identification.held_out import is_held_out
from mbot_workstation.identification.mixed_fit import MixedFit, begin
from mbot_workstation.identification.preparation import prepare
from mbot_workstation.identification.run_view import RunView, simulate_views
from mbot_workstation.recordings.run import Recording
from mbot_workstation.recordings.track import Array
from mbot_workstation.simulation.robot_parameters import RobotParameters
from mbot_workstation.simulation.scene_mjcf import TIMESTEP_S

GRID_S = 0.02
"""Between the moments compared; the tracked place at each is a mean over 0.1 s."""

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
    words = "Every other repetition of each manoeuvre, which `identify` did not fit."
    if files.motion is None or not shown:
        shown = list(prepared.views)
        words = "All runs: nothing was fitted to them."
        if files.motion is not None:
            words = "All runs: none was repeated, so none could be held out of the fit."
    fit = MixedFit(fitted, prepared.fixed, begin(fitted, robot, prepared.fixed.guess))
    fit.run((), ROUNDS)
    settings = fit.state.settings
    first = min(prepared.views, key=lambda view: view.flat.run.commands.start_s)
    compared = _compared([*shown, first], settings, files.robot)
    return Comparison(
        tuple(compared[:-1]),
        compared[-1] if first.flat.run.number == recordings[0].runs[0].number else None,
        words,
        prepared.left_out,
    )


def _compared(
    views: Sequence[RunView], settings: Array, calibrated: RobotParameters
) -> list[ComparedRun]:
    calm = [np.zeros(view.deviations) for view in views]
    paths = [
        simulate_views(views, [robot] * len(views), calm)
        for robot in (calibrated, RobotParameters())
    ]
    return [
        _beside(view, settings[view.flat.recording], mine, nominal)
        for view, mine, nominal in zip(views, *paths, strict=True)
    ]


def _beside(view: RunView, setting: Array, calibrated: Array, nominal: Array) -> ComparedRun:
    run = view.flat.run
    time_s = np.arange(0, view.covered_s[1], GRID_S)
    ends = [view.end(setting, float(at_s)) for at_s in time_s]
    measured = np.array([[place.real, place.imag, heading] for place, heading in ends])
    simulated = [_at(path, time_s) for path in (calibrated, nominal)]
    return ComparedRun(
        run.number, run.maneuver, run.repetition, view.drive_s, time_s, measured, *simulated
    )


def _at(path: Array, time_s: Array) -> Array:
    """A simulated path at these moments. Shape (n, 3)."""
    grid_s = TIMESTEP_S * np.arange(len(path))
    return np.stack([np.interp(time_s, grid_s, column) for column in path.T], axis=1)
