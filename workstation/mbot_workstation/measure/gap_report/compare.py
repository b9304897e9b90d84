"""From recordings to held-out runs, each beside two simulated ones in the same frame and clock."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import savgol_filter

from mbot_workstation.measure.identification.dataset import prepare
from mbot_workstation.measure.identification.exclusion import Exclusion
from mbot_workstation.measure.identification.fit import align, start_delays_s
from mbot_workstation.measure.identification.observed_run import ObservedRun
from mbot_workstation.measure.identification.outliers import outlying_runs
from mbot_workstation.measure.identification.rollout import rollouts
from mbot_workstation.measure.identification.validation import axle_path, is_held_out
from mbot_workstation.measure.tracks.run import ManeuverRecording
from mbot_workstation.measure.tracks.track import Array
from mbot_workstation.sim.body.parameter_table import with_values
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.calibrated.calibration_folder import CalibrationFiles
from mbot_workstation.sim.engine import TIMESTEP_S

MEASURED, CALIBRATED, NOMINAL = PATHS = ("measured", "calibrated", "nominal")

GRID_S = 0.02
"""Between the moments compared."""

MIDDLE = 0.5
"""Of a session: how far the battery has run down in a run that one knows nothing of."""

REACH_S = 0.05
"""To each side of a moment; a straight line through the poses there is the place at the moment. A
tenth of a second of 90 Hz makes 1.3 mm of 4, and bends a robot's smallest circle by 0.3."""

SETTLED_S = 0.6
"""Since the first command: even a motor of 200 ms has 95 % of its speed."""

SHORTEST_S = 0.5
"""Less driving than this says no speed: 4 mm of noise would be 2 % of it."""


@dataclass(frozen=True, slots=True)
class Rate:
    """Steady driving: speed of the axle's centre ahead, turn rate to the left."""

    speed_mps: float
    turn_radps: float


@dataclass(frozen=True, slots=True, eq=False)
class ComparedRun:
    """One run that the calibration has not been fitted to, beside two simulated ones.

    Poses are x [m], y [m] of the axle's centre and yaw [rad], which counts whole turns; each path
    begins in the origin, heading along +x, when the first command takes effect.

    Attributes:
        number, repetition: as recorded.
        maneuver: its name, such as "forward-neutral".
        driven_s: from the first command to the stop.
        time_s: since the first command took effect, shape (n,), rising, ends with the drive.
        measured, calibrated, nominal: the tracked robot, the simulated one with its calibration,
            and the simulated one without; shape (n, 3).

    """

    number: int
    maneuver: str
    repetition: int
    driven_s: float
    time_s: Array
    measured: Array
    calibrated: Array
    nominal: Array

    @property
    def turned_rad(self) -> float:
        """How far the robot turned, positive to the left."""
        return float(self.measured[-1, 2] - self.measured[0, 2])

    @property
    def is_steady(self) -> bool:
        """Whether it was driven long enough for a rate."""
        return bool(self.time_s[-1] >= SETTLED_S + SHORTEST_S)

    def off(self, path: str) -> Array:
        """A simulated path less the measured one. Shape (n, 3)."""
        return getattr(self, path) - self.measured

    def rate(self, path: str) -> Rate:
        """Steady driving on one of the paths."""
        return steady_rate(self.time_s, getattr(self, path))


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """Runs that were not fitted and which they are; the session's first run, in which frames were
    taken, if it can be used; and by name why runs can't be used.
    """

    held_out: tuple[ComparedRun, ...]
    first: ComparedRun | None
    words: str
    excluded: dict[str, Exclusion]


def compare(recordings: Sequence[ManeuverRecording], files: CalibrationFiles) -> Comparison:
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
    problem, solution = align(data, robot, np.flatnonzero(~away).tolist())
    chosen, words = away, "Every other repetition of each maneuver: those that were held out."
    if files.motion is None or not away.any():
        chosen, words = np.ones_like(away), "All runs: nothing was fitted to them."
        if files.motion is not None:
            words = "All runs: none was repeated, so none could be held out of the fit."
    # As `identify` does: a run with a blocked wheel or a hand on the robot is no measurement.
    outliers = {} if files.motion is None else outlying_runs(problem, solution)
    shown = [index for index in np.flatnonzero(chosen).tolist() if index not in outliers]
    first = min(range(len(away)), key=lambda i: data.runs[i].flat.run.commands.start_s)
    # Apart: a batch takes robots of the same parts only.
    paths = [rollouts([one], problem.plans)[0] for one in (calibrated, RobotParameters())]
    delay_s, settings = start_delays_s(problem, solution), solution.state.settings

    def beside(index: int) -> ComparedRun:
        run = data.runs[index]
        setting, plan = settings[run.flat.recording], problem.which[index]
        return _beside(run, setting, float(delay_s[index]), *(path[plan] for path in paths))

    is_first = data.runs[first].flat.run.number == recordings[0].runs[0].number
    return Comparison(
        tuple(beside(index) for index in shown),
        beside(first) if is_first else None,
        words,
        data.excluded | data.by_name(outliers),
    )


def _beside(
    observed: ObservedRun, setting: Array, delay_s: float, calibrated: Array, nominal: Array
) -> ComparedRun:
    run = observed.flat.run
    axle, heading, when_s = axle_path(observed, setting, delay_s)
    # The track may end before the drive does, by a little: see `data.LEAST_COVERED`.
    until_s = min(observed.drive_s, float(when_s[-1]))
    time_s = np.linspace(0, until_s, max(2, round(until_s / GRID_S) + 1))
    paths = [
        line_at(when_s, np.stack([axle.real, axle.imag, heading], axis=1), time_s),
        *(
            _at(np.arange(len(p), dtype=float) * TIMESTEP_S, p, time_s)
            for p in (calibrated, nominal)
        ),
    ]
    return ComparedRun(run.number, run.maneuver, run.repetition, observed.drive_s, time_s, *paths)


def line_at(seen_s: Array, seen: Array, time_s: Array) -> Array:
    """Samples, shape (n, columns), at these moments, smoothed over `REACH_S` to each side.

    Times are smoothed with the values, so what moves evenly stays where it is, also beside gaps.
    """
    within = 2 * round(REACH_S / float(np.median(np.diff(seen_s)))) + 1
    within = min(max(3, within), len(seen_s) - 1 | 1)
    columns = np.column_stack([seen_s, seen])
    smooth = np.asarray(savgol_filter(columns, within, 1, axis=0), np.float64)
    return _at(np.maximum.accumulate(smooth[:, 0]), smooth[:, 1:], time_s)


def _at(grid_s: Array, path: Array, time_s: Array) -> Array:
    return np.stack([np.interp(time_s, grid_s, column) for column in path.T], axis=1)


def steady_rate(time_s: Array, path: Array) -> Rate:
    """Least squares over the steady part of a path.

    Args:
        time_s: since the first command, shape (n,).
        path: x, y, yaw; shape (n, 3).

    """
    steady = time_s >= SETTLED_S
    since_s, (x, y, yaw) = time_s[steady] - SETTLED_S, path[steady].T
    turn_radps, heading = np.polyfit(since_s, yaw, 1)
    # A robot that turns steadily and drives at v has gone v times this far.
    ways = np.exp(1j * (heading + turn_radps * since_s))
    gone = np.append(0, np.cumsum((ways[1:] + ways[:-1]) / 2 * np.diff(since_s)))
    columns = np.column_stack([np.ones_like(gone), gone])
    velocity = np.linalg.lstsq(columns, x + 1j * y, rcond=None)[0][1]
    return Rate(float(velocity.real), float(turn_radps))
