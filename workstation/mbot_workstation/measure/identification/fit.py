"""From recordings to a robot: one problem, solved for half of the repetitions, judged on the other
half, and solved for all.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.measure.identification.conclusions import estimates, latency, steady_rates
from mbot_workstation.measure.identification.dataset import Dataset, prepare
from mbot_workstation.measure.identification.outliers import outlying_runs
from mbot_workstation.measure.identification.prediction import NUISANCE, Noise
from mbot_workstation.measure.identification.result import Identification, Misfit
from mbot_workstation.measure.identification.solver import (
    Problem,
    Solution,
    Solver,
    State,
    VarianceComponents,
    initial_state,
    spreads,
)
from mbot_workstation.measure.identification.validation import (
    held_out_errors,
    is_held_out,
    repeatability,
)
from mbot_workstation.measure.identification.variance_components import (
    estimate_misfit,
    estimate_noise,
    estimate_variances,
)
from mbot_workstation.measure.tracks.run import ManeuverRecording
from mbot_workstation.measure.tracks.track import Array
from mbot_workstation.sim.body.parameter_table import TOLD_BY_DRIVING, usual, with_values
from mbot_workstation.sim.body.robot_parameters import RobotParameters

MOST_ITERATIONS = 8
"""Of fitting, learning the scatter, and fitting again; those tried settled in 2 to 6. So that a fit
ends that goes to and fro."""

SETTLED = 0.1
"""Of a parameter's standard deviation: a round that moves none by more is the last."""

FRICTIONLESS: dict[str, float] = {
    "left_dry_friction": 0,
    "right_dry_friction": 0,
    "rolling_drag_n": 0,
    "turning_drag_n_m": 0,
}
STARTS: tuple[tuple[dict[str, float], float], ...] = (
    ({}, 1.0),
    (FRICTIONLESS, 1.0),
    (FRICTIONLESS, 0.5),
)
"""What differs from what is usual, and the grip against the usual one. Friction that holds a wheel
and a floor that lets it slip are not smooth: from what is usual alone four of five drives of a
robot without friction descended into a valley of too much drag, a third above the other's cost."""

FADE_OF_SCATTER = 6**0.5
"""A battery that fades evenly over the runs makes them scatter by its fade over the root of 12.
Half of the variance that both motors have in common is taken for the battery's; the floor and the
day make the rest (assumed)."""

Advance = Callable[[float], None]
"""Called with the share of the work that is done."""


def identify(
    recordings: Sequence[ManeuverRecording],
    nominal: RobotParameters,
    *,
    robot_id: str,
    same_clock: bool = False,
    advance: Advance | None = None,
) -> Identification:
    """Identify one robot.

    Args:
        recordings: of this robot, all with the same tracker or not.
        nominal: what is known of it: body and camera calibrated or not, motors nominal.
        robot_id: whose.
        same_clock: the trackers' times are the robot's clock. Then the delay from command to
            wheel can be told, the tracker's own delay included.
        advance: progress.

    Raises:
        ConfigurationError: the recordings can't be fitted; the text says why.

    """
    progress = _Progress(advance)
    data = prepare(recordings, nominal, same_clock=same_clock)
    away = np.array(is_held_out(data.runs))
    _check_enough(data, away)
    half = _Fit.multistart(data, _indices(~away), progress)
    whole = _Fit.warm_start(data, half, progress)
    outliers = outlying_runs(whole.problem, whole.solution)
    if outliers:
        data = data.without(outliers)
        away = np.array(is_held_out(data.runs))
        _check_enough(data, away)
        half = _Fit.warm_start(data, whole, progress, _indices(~away))
        whole = _Fit.warm_start(data, half, progress)
    return _conclude(robot_id, data, half, whole, _indices(away), same_clock=same_clock)


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    """A solved problem, with the variances and the noise estimated from it."""

    problem: Problem
    solution: Solution
    variances: VarianceComponents
    noise: list[Noise]

    @classmethod
    def multistart(cls, data: Dataset, chosen: Sequence[int], progress: "_Progress") -> "_Fit":
        """Fit some runs from each of the starts; the likeliest robot wins."""
        problem, noise = data.problem(chosen, TOLD_BY_DRIVING), data.noise()
        middle = {name: usual(data.robot, name) for name in TOLD_BY_DRIVING} | dict(data.guessed)
        found: list[_Fit] = []
        for differs, grip in STARTS:
            start = middle | differs | {"wheel_friction": grip * middle["wheel_friction"]}
            state = initial_state(problem, with_values(data.robot, start))
            found.append(cls._converged(problem, state, VarianceComponents(), noise, progress))
        alike = Solver(problem, VarianceComponents(), noise)  # each has variances of its own
        return min(found, key=lambda one: alike.evaluate(one.solution.state).cost)

    @classmethod
    def warm_start(
        cls,
        data: Dataset,
        before: "_Fit",
        progress: "_Progress",
        chosen: Sequence[int] | None = None,
    ) -> "_Fit":
        """Fit other runs of the same robot from where a fit has come."""
        everything = range(len(data.runs)) if chosen is None else chosen
        problem = data.problem(everything, TOLD_BY_DRIVING)
        came = before.solution.state
        state = replace(initial_state(problem, came.robot), settings=came.settings)
        return cls._converged(problem, state, before.variances, before.noise, progress)

    @classmethod
    def _converged(
        cls,
        problem: Problem,
        state: State,
        variances: VarianceComponents,
        noise: list[Noise],
        progress: "_Progress",
    ) -> "_Fit":
        left = MOST_ITERATIONS
        while True:
            solution = Solver(problem, variances, noise).solve(state, 1)
            moved = spreads(problem, solution.state.robot) - spreads(problem, state.robot)
            state = solution.state
            variances = estimate_variances(problem.runs, solution)
            noise = estimate_noise(problem.runs, solution, noise)
            settled = (np.abs(moved) < SETTLED * np.sqrt(np.diag(solution.covariance))).all()
            if settled or left == 1:
                progress.count(left)
                return cls(problem, solution, variances, noise)
            progress.count()
            left -= 1


class _Progress:
    """Work done, counted in rounds."""

    def __init__(self, advance: Advance | None) -> None:
        self._advance, self._done = advance, 0
        self._all = (len(STARTS) + 1) * MOST_ITERATIONS

    def count(self, rounds: int = 1) -> None:
        self._done += rounds
        if self._advance is not None:
            self._advance(min(self._done / self._all, 1.0))


def _indices(chosen: Array) -> list[int]:
    return np.flatnonzero(chosen).tolist()


def _check_enough(data: Dataset, away: Array) -> None:
    if away.any() and not away.all():
        return
    without = f" without the {len(data.excluded)} that can't be used" if data.excluded else ""
    raise ConfigurationError(
        f"{len(data.runs)} runs{without}, and no maneuver twice: half of the repetitions "
        "is held out to judge the result; drive each maneuver at least twice"
    )


def _conclude(
    robot_id: str, data: Dataset, half: _Fit, whole: _Fit, away: Sequence[int], *, same_clock: bool
) -> Identification:
    state = whole.solution.state
    told = float((1 - np.diag(whole.solution.covariance).clip(0, 1)).sum())
    variances = replace(whole.variances, misfit=estimate_misfit(whole.solution, told))
    # From here on, what the model gets wrong in a maneuver counts as what it may get wrong.
    evaluated = Solver(whole.problem, variances, whole.noise).evaluate(state)
    fade = FADE_OF_SCATTER * _common_scatter(whole, variances)
    mean = state.robot
    fresh = with_values(
        mean,
        {
            "left_gain": mean.left_motor.gain / (1 - fade / 2),
            "right_gain": mean.right_motor.gain / (1 - fade / 2),
            "battery_fade": fade,
        },
    )
    known = half.solution.state
    problem, held = _fit_delays(data, away, known, half.variances, half.noise)
    plans = (problem.plans, problem.which)
    delays_s = start_delays_s(problem, held)
    return Identification(
        robot_id,
        data.robot,
        fresh,
        estimates(evaluated, whole.problem, fresh, data.robot, fade),
        latency(evaluated, whole.problem, data, same_clock=same_clock),
        tuple(float(setting[1]) for setting in state.settings),
        tuple((float(s[2]), float(s[3]), float(s[4])) for s in state.settings),
        variances,
        tuple(
            Misfit(name, *(float(share) for share in shares[:3]))
            for name, shares in state.misfit.items()
        ),
        steady_rates(evaluated, whole.problem, fresh, variances, fade),
        held_out_errors(problem.runs, *plans, known.settings, delays_s, data.robot, known.robot),
        repeatability(data.runs, state.settings, state.nuisance[:, NUISANCE.index("delay")]),
        len(data.runs),
        data.excluded,
    )


def _common_scatter(fit: _Fit, variances: VarianceComponents) -> float:
    """Of both motors' strength alike over the session, what ran down with time included."""
    drained = [
        fit.solution.state.settings[run.flat.recording, 5] * run.since_others_s
        for run in fit.problem.runs
    ]
    return float(np.hypot(variances.battery, np.std(drained)))


def align(data: Dataset, robot: RobotParameters, fitted: Sequence[int]) -> tuple[Problem, Solution]:
    """Find the recordings' settings from some runs, and when all of them began; no parameter.

    Args:
        data: of the recordings.
        robot: taken as it is.
        fitted: indices of the runs that may tell the settings.

    """
    problem = data.problem(fitted, ())
    variances, noise = VarianceComponents(), data.noise()
    settled = Solver(problem, variances, noise).solve(initial_state(problem, robot), 2)
    return _fit_delays(data, range(len(data.runs)), settled.state, variances, noise)


def _fit_delays(
    data: Dataset,
    chosen: Sequence[int],
    known: State,
    variances: VarianceComponents,
    noise: list[Noise],
) -> tuple[Problem, Solution]:
    """When runs began, with everything else as it is known."""
    free = data.problem(chosen, ())
    held = replace(free, free=np.zeros_like(free.free), guess=known.settings)
    return held, Solver(held, variances, noise).solve(initial_state(held, known.robot), 2)


def start_delays_s(problem: Problem, solution: Solution) -> Array:
    """How much later each run began than its clock says. Shape (runs,).

    A run on a shared clock began when it says, as far as anybody may know beforehand.
    """
    delays_s = solution.state.nuisance[:, NUISANCE.index("delay")]
    return np.where([run.own_clock for run in problem.runs], delays_s, 0.0)
