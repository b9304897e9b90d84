"""From recordings to a robot: one problem, solved for half of the repetitions, judged on the other
half, and solved for all.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.measure.identification.conclusions import estimates, latency, steady_rates
from mbot_workstation.measure.identification.data import Data, prepare
from mbot_workstation.measure.identification.held_out import errors, is_held_out, repeatability
from mbot_workstation.measure.identification.prediction import OWN, Noise
from mbot_workstation.measure.identification.result import Identification, Misfit
from mbot_workstation.measure.identification.scatter import learn_misfit, learn_noise, learn_scatter
from mbot_workstation.measure.identification.solver import (
    Problem,
    Scatter,
    Solution,
    Solver,
    State,
    begun,
    spreads,
)
from mbot_workstation.measure.identification.stray import stray_runs
from mbot_workstation.measure.tracks.run import Recording
from mbot_workstation.sim.body.parameter_table import TOLD_BY_DRIVING, usual, with_values
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.track import Array

MOST_ROUNDS = 8
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
    recordings: Sequence[Recording],
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
    bar = _Bar(advance)
    data = prepare(recordings, nominal, same_clock=same_clock)
    away = np.array(is_held_out(data.runs))
    _check_enough(data, away)
    half = _Fit.begin(data, _indices(~away), bar)
    whole = _Fit.go_on(data, half, bar)
    stray = stray_runs(whole.problem, whole.solution)
    if stray:
        data = data.without(stray)
        away = np.array(is_held_out(data.runs))
        _check_enough(data, away)
        half = _Fit.go_on(data, whole, bar, _indices(~away))
        whole = _Fit.go_on(data, half, bar)
    return _conclude(robot_id, data, half, whole, _indices(away), same_clock=same_clock)


class _Fit:
    """A problem, solved or about to be, with the scatter and the noise that it taught."""

    def __init__(
        self,
        problem: Problem,
        state: State,
        scatter: Scatter,
        noise: list[Noise],
        solution: Solution | None = None,
    ) -> None:
        self.problem, self._state, self._solution = problem, state, solution
        self.scatter, self.noise = scatter, noise

    @property
    def solution(self) -> Solution:
        if self._solution is None:
            raise ValueError("nothing has been solved yet")
        return self._solution

    @classmethod
    def begin(cls, data: Data, chosen: Sequence[int], bar: "_Bar") -> "_Fit":
        """Fit some runs from each of the starts; the likeliest robot wins."""
        problem, noise = data.problem(chosen, TOLD_BY_DRIVING), data.noise()
        middle = {name: usual(data.robot, name) for name in TOLD_BY_DRIVING} | dict(data.guessed)
        found: list[_Fit] = []
        for differs, grip in STARTS:
            start = middle | differs | {"wheel_friction": grip * middle["wheel_friction"]}
            state = begun(problem, with_values(data.robot, start))
            found.append(cls(problem, state, Scatter(), noise)._settled(bar))
        alike = Solver(problem, Scatter(), noise)  # each has learned a scatter of its own
        return min(found, key=lambda one: alike.judge(one.solution.state).cost)

    @classmethod
    def go_on(
        cls, data: Data, before: "_Fit", bar: "_Bar", chosen: Sequence[int] | None = None
    ) -> "_Fit":
        """Fit other runs of the same robot from where a fit has come."""
        everything = range(len(data.runs)) if chosen is None else chosen
        problem = data.problem(everything, TOLD_BY_DRIVING)
        came = before.solution.state
        state = replace(begun(problem, came.robot), settings=came.settings)
        return cls(problem, state, before.scatter, before.noise)._settled(bar)

    def _settled(self, bar: "_Bar") -> "_Fit":
        state, scatter, noise, solution = self._state, self.scatter, self.noise, self._solution
        for done in range(MOST_ROUNDS):
            solution = Solver(self.problem, scatter, noise).solve(state, 1)
            moved = spreads(self.problem, solution.state.robot) - spreads(self.problem, state.robot)
            state = solution.state
            scatter = learn_scatter(self.problem.runs, solution)
            noise = learn_noise(self.problem.runs, solution, noise)
            if (np.abs(moved) < SETTLED * np.sqrt(np.diag(solution.covariance))).all():
                bar.count(MOST_ROUNDS - done)
                break
            bar.count()
        return _Fit(self.problem, state, scatter, noise, solution)


class _Bar:
    """Work done, counted in rounds."""

    def __init__(self, advance: Advance | None) -> None:
        self._advance, self._done = advance, 0
        self._all = (len(STARTS) + 1) * MOST_ROUNDS

    def count(self, rounds: int = 1) -> None:
        self._done += rounds
        if self._advance is not None:
            self._advance(min(self._done / self._all, 1.0))


def _indices(chosen: Array) -> list[int]:
    return np.flatnonzero(chosen).tolist()


def _check_enough(data: Data, away: Array) -> None:
    if away.any() and not away.all():
        return
    without = f" without the {len(data.left_out)} that can't be used" if data.left_out else ""
    raise ConfigurationError(
        f"{len(data.runs)} runs{without}, and no maneuver twice: half of the repetitions "
        "is held out to judge the result; drive each maneuver at least twice"
    )


def _conclude(
    robot_id: str, data: Data, half: _Fit, whole: _Fit, away: Sequence[int], *, same_clock: bool
) -> Identification:
    state = whole.solution.state
    told = float((1 - np.diag(whole.solution.covariance).clip(0, 1)).sum())
    scatter = replace(whole.scatter, misfit=learn_misfit(whole.solution, told))
    # From here on, what the model gets wrong in a maneuver counts as what it may get wrong.
    judged = Solver(whole.problem, scatter, whole.noise).judge(state)
    fade = FADE_OF_SCATTER * _common_scatter(whole, scatter)
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
    problem, held = _begun_all(data, away, known, half.scatter, half.noise)
    plans = (problem.plans, problem.which)
    later = begins_s(problem, held)
    return Identification(
        robot_id,
        data.robot,
        fresh,
        estimates(judged, whole.problem, fresh, data.robot, fade),
        latency(judged, whole.problem, data, same_clock=same_clock),
        tuple(float(setting[1]) for setting in state.settings),
        tuple((float(s[2]), float(s[3]), float(s[4])) for s in state.settings),
        scatter,
        tuple(
            Misfit(name, *(float(share) for share in shares[:3]))
            for name, shares in state.misfit.items()
        ),
        steady_rates(judged, whole.problem, fresh, scatter, fade),
        errors(problem.runs, *plans, known.settings, later, data.robot, known.robot),
        repeatability(data.runs, state.settings, state.own[:, OWN.index("later")]),
        len(data.runs),
        data.left_out,
    )


def _common_scatter(fit: _Fit, scatter: Scatter) -> float:
    """Of both motors' strength alike over the session, what ran down with time included."""
    drained = [
        fit.solution.state.settings[run.flat.recording, 5] * run.since_others_s
        for run in fit.problem.runs
    ]
    return float(np.hypot(scatter.battery, np.std(drained)))


def aligned(data: Data, robot: RobotParameters, fitted: Sequence[int]) -> tuple[Problem, Solution]:
    """Find the recordings' settings from some runs, and when all of them began; no parameter.

    Args:
        data: of the recordings.
        robot: taken as it is.
        fitted: indices of the runs that may tell the settings.

    """
    problem = data.problem(fitted, ())
    scatter, noise = Scatter(), data.noise()
    settled = Solver(problem, scatter, noise).solve(begun(problem, robot), 2)
    return _begun_all(data, range(len(data.runs)), settled.state, scatter, noise)


def _begun_all(
    data: Data, chosen: Sequence[int], known: State, scatter: Scatter, noise: list[Noise]
) -> tuple[Problem, Solution]:
    """When runs began, with everything else as it is known."""
    free = data.problem(chosen, ())
    held = replace(free, free=np.zeros_like(free.free), guess=known.settings)
    return held, Solver(held, scatter, noise).solve(begun(held, known.robot), 2)


def begins_s(problem: Problem, solution: Solution) -> Array:
    """How much later each run began than its clock says. Shape (runs,).

    A run on a shared clock began when it says, as far as anybody may know beforehand.
    """
    own = solution.state.own[:, OWN.index("later")]
    return np.where([run.own_clock for run in problem.runs], own, 0.0)
