"""One least-squares problem in parameters and settings; nuisance parameters are projected out.

Those are a run's own deviations and what the model gets wrong in all runs of a maneuver. They enter
the increments linearly; projecting them out leaves a problem in some twenty unknowns, whatever the
number of runs (variable projection: Golub and Pereyra 1973; Kaufman's Jacobian).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from mbot_workstation.measure.identification.arrowhead import Arrowhead
from mbot_workstation.measure.identification.observed_run import ObservedRun, maneuvers
from mbot_workstation.measure.identification.prediction import (
    MISFIT,
    NUISANCE,
    SETTING,
    SETTING_SPREAD,
    Noise,
    Whitener,
    jacobians,
    predicted,
)
from mbot_workstation.measure.identification.rollout import Plan, rollouts
from mbot_workstation.measure.tracks.track import Array
from mbot_workstation.sim.body.parameter_table import BY_NAME, usual, value, with_values
from mbot_workstation.sim.body.robot_parameters import RobotParameters

Indices: TypeAlias = NDArray[np.intp]

STEP = 0.05
"""Of a parameter's spread, for differences: small against what matters, large against what the
soft contacts of the simulation do by themselves."""

OWN_CLOCK_S = 0.1
"""How uncertain a run's beginning is when its clock is its own."""

SLOW_CLOCK_S = 0.5
"""Likewise of a slow run, which moves from a command on that nobody knows yet."""

MOST_EVALUATIONS = 8
"""Of the residuals in one iteration, before the nuisance parameters are linearised again."""


_NO_MISFIT = np.zeros((len(NUISANCE), len(MISFIT)))


@dataclass(frozen=True, slots=True)
class VarianceComponents:
    """Prior standard deviations of the nuisance parameters and of the misfit.

    Attributes:
        battery: of both wheels' speeds alike, from run to run, as a share.
        motor: of each wheel's speed by itself, from run to run, as a share.
        sideways: from run to run, as a share of the faster wheel's speed.
        moment_s: of the delay of a run's beginning, where the clocks are one.
        misfit: of what the model gets wrong in all runs of a maneuver, as a share of the faster
            wheel's speed.
        start: likewise while the robot gets going: no model has quite the curve of a real start.

    """

    battery: float = 0.01
    motor: float = 0.01
    sideways: float = 0.01
    moment_s: float = 0.005
    misfit: float = 0.005
    start: float = 0.03

    def misfit_sd(self) -> Array:
        """Of `prediction.MISFIT`. Shape (5,)."""
        return np.array([*[self.misfit] * 3, *[self.start] * 2])

    def nuisance_root(self, run: ObservedRun) -> Array:
        """Inverse Cholesky root of the prior covariance of a run's nuisance. Shape (4, 4)."""
        guessed_s = SLOW_CLOCK_S if run.flat.run.is_slow else OWN_CLOCK_S
        moment_s = guessed_s if run.own_clock else self.moment_s
        covariance = np.diag([self.motor**2, self.motor**2, self.sideways**2, moment_s**2])
        covariance[:2, :2] += self.battery**2
        return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)), np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """What is to be fitted.

    Attributes:
        runs: at least one.
        plans: the different ones among them; which: each run's.
        robot: as far as it is known; what driving can't tell stays.
        guess: of the recordings' settings, shape (recordings, 6).
        free: which of them may move, same shape.
        names: of the parameters to fit.

    """

    runs: tuple[ObservedRun, ...]
    plans: tuple[Plan, ...]
    which: tuple[int, ...]
    robot: RobotParameters
    guess: Array
    free: Array
    names: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """What the fit moves.

    Attributes:
        robot: with the parameters as they are now.
        settings: shape (recordings, 6).
        nuisance: of each run, see `prediction.NUISANCE`; shape (runs, 4).
        misfit: of each maneuver, see `prediction.MISFIT`.

    """

    robot: RobotParameters
    settings: Array
    nuisance: Array
    misfit: dict[str, Array]


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """A state at a minimum.

    Attributes:
        state: the state.
        cost: half the sum of squares, priors included.
        covariance: of the parameters, in units of their spread, whatever the settings; shape
            (names, names).
        setting_sd: standard deviations of the settings, shape (recordings, 6).
        residuals: increments that nothing explains, of each run, shape (3, n).

    """

    state: State
    cost: float
    covariance: Array
    setting_sd: Array
    residuals: tuple[Array, ...]


def spreads(problem: Problem, robot: RobotParameters) -> Array:
    """A robot's parameters, in units of their spread from what is usual. Shape (names,)."""
    return np.array(
        [
            (value(robot, name) - usual(problem.robot, name)) / BY_NAME[name].spread
            for name in problem.names
        ]
    )


class _Unknowns:
    """Parameters in units of their spread from usual, then free settings in theirs from a guess."""

    def __init__(self, problem: Problem) -> None:
        self._problem = problem
        self.names = problem.names
        self._usual = np.array([usual(problem.robot, name) for name in self.names])
        self._spread = np.array([BY_NAME[name].spread for name in self.names])
        self._free = np.flatnonzero(problem.free.ravel())
        limits = [(BY_NAME[name].low, BY_NAME[name].high) for name in self.names]
        low, high = np.array(limits, np.float64).reshape(len(limits), 2).T
        unlimited = np.full(self._free.size, np.inf)
        self.low = np.append((low - self._usual) / self._spread, -unlimited)
        self.high = np.append((high - self._usual) / self._spread, unlimited)

    def of(self, state: State) -> Array:
        settings = (state.settings - self._problem.guess) / SETTING_SPREAD
        return np.append(spreads(self._problem, state.robot), settings.ravel()[self._free])

    def robot(self, unknowns: Array) -> RobotParameters:
        values = self._usual + self._spread * unknowns[: len(self.names)]
        pairs = zip(self.names, values.tolist(), strict=True)
        return with_values(self._problem.robot, dict(pairs))

    def settings(self, unknowns: Array) -> Array:
        moved = np.zeros(self._problem.guess.size)
        moved[self._free] = unknowns[len(self.names) :]
        return self._problem.guess + moved.reshape(-1, len(SETTING)) * SETTING_SPREAD

    def chosen_settings(self, recording: int) -> tuple[Indices, Indices]:
        """Of a recording's settings those that are free, and where they stand among all."""
        first = len(SETTING) * recording
        mine = np.flatnonzero((self._free >= first) & (self._free < first + len(SETTING)))
        return self._free[mine] - first, len(self.names) + mine


@dataclass(frozen=True, slots=True, eq=False)
class _ManeuverGroup:
    """The runs of one maneuver, and the columns of its nuisance parameters. In its rows each run's
    increments are followed by the priors of its nuisance, and those of the misfit come last."""

    runs: tuple[int, ...]
    nuisance: Arrowhead


class Solver:
    """Variable projection of one problem, for given variance components and noise.

    With p the parameters and free settings in units of their prior's standard deviation, n the
    nuisance parameters and misfits, W the whitening of increments and priors: minimise

        |p|^2 + |W (seen - predicted(p)) - A n|^2.

    For given p the best n is a linear least squares, so what remains is

        |p|^2 + |P W (seen - predicted(p))|^2,  P = I - A A^+,

    whose Jacobian is [I; -P W d predicted / dp] (Kaufman's, P held).
    """

    def __init__(
        self, problem: Problem, variances: VarianceComponents, noise: Sequence[Noise]
    ) -> None:
        self.problem, self._variances = problem, variances
        self._unknowns = _Unknowns(problem)
        self._whiteners = [Whitener(run, noise[run.flat.recording]) for run in problem.runs]

    def solve(self, state: State, iterations: int) -> Solution:
        """Descend in the parameters; each iteration linearises the nuisance parameters again."""
        result = None
        for _ in range(iterations):
            delays_s = state.nuisance[:, NUISANCE.index("delay")]
            groups = self._groups(state)
            if not self._unknowns.low.size:
                state, residuals = self._state(np.zeros(0), groups, delays_s)
                result = self._solution(state, 0.0, np.zeros((0, 0)), residuals)
                continue
            found = least_squares(
                lambda u, g=groups, delays_s=delays_s: self._residuals(u, g, delays_s),
                np.clip(self._unknowns.of(state), self._unknowns.low, self._unknowns.high),
                jac=lambda u, g=groups, delays_s=delays_s: self._jacobian(u, g, delays_s),  # pyright: ignore
                bounds=(self._unknowns.low, self._unknowns.high),
                max_nfev=MOST_EVALUATIONS,
                xtol=1e-4,
                ftol=1e-5,
                x_scale=1.0,
            )
            state, residuals = self._state(found.x, groups, delays_s)
            result = self._solution(state, float(found.cost), found.jac, residuals)
        if result is None:
            raise ValueError(f"iterations is {iterations}, expected at least 1")
        return result

    def _groups(self, state: State) -> list[_ManeuverGroup]:
        (paths,) = rollouts([state.robot], self.problem.plans)
        groups: list[_ManeuverGroup] = []
        for members in maneuvers(self.problem.runs).values():
            columns: list[tuple[Array, Array]] = []
            for index in members:
                run = self.problem.runs[index]
                found = jacobians(
                    run,
                    paths[self.problem.which[index]],
                    state.settings[run.flat.recording],
                    float(state.nuisance[index, -1]),
                    state.robot.track_m,
                )
                nuisance = self._whiten(index, found.nuisance).T
                shared = self._whiten(index, found.misfit).T
                prior = self._variances.nuisance_root(run)
                columns.append((np.vstack([nuisance, prior]), np.vstack([shared, _NO_MISFIT])))
            shared_prior = np.diag(1 / self._variances.misfit_sd())
            groups.append(_ManeuverGroup(tuple(members), Arrowhead.of(columns, shared_prior)))
        return groups

    def _whiten(self, index: int, increments: Array) -> Array:
        """Of shape (..., 3, n) to (..., 3 n)."""
        white = self._whiteners[index].whiten(increments)
        return white.reshape(*white.shape[:-2], white.shape[-2] * white.shape[-1])

    def _residuals(
        self, unknowns: Array, groups: Sequence[_ManeuverGroup], delays_s: Array
    ) -> Array:
        whole = self._whitened_residuals(unknowns, groups, delays_s)
        parts = [g.nuisance.project_out(rows) for g, rows in zip(groups, whole, strict=True)]
        return np.concatenate([unknowns, *parts])

    def _whitened_residuals(
        self, unknowns: Array, groups: Sequence[_ManeuverGroup], delays_s: Array
    ) -> list[Array]:
        """Of each group, before the projection. Shape (rows,) each."""
        (paths,) = rollouts([self._unknowns.robot(unknowns)], self.problem.plans)
        settings = self._unknowns.settings(unknowns)
        whitened: list[Array] = []
        for group in groups:
            parts: list[Array] = []
            for index in group.runs:
                run = self.problem.runs[index]
                path, setting = paths[self.problem.which[index]], settings[run.flat.recording]
                off = run.seen - predicted(run, path, setting, float(delays_s[index]))
                now = np.array([0, 0, 0, delays_s[index]])
                parts += [self._whiten(index, off), -self._variances.nuisance_root(run) @ now]
            whitened.append(np.concatenate([*parts, np.zeros(len(MISFIT))]))
        return whitened

    def _jacobian(
        self, unknowns: Array, groups: Sequence[_ManeuverGroup], delays_s: Array
    ) -> Array:
        names, robot = self._unknowns.names, self._unknowns.robot(unknowns)
        settings = self._unknowns.settings(unknowns)
        # One-sided differences, away from a limit.
        signs = [
            -1.0 if unknowns[i] + STEP > self._unknowns.high[i] else 1.0 for i in range(len(names))
        ]
        moved = [
            self._unknowns.robot(unknowns + sign * STEP * np.eye(unknowns.size)[i])
            for i, sign in enumerate(signs)
        ]
        driven = rollouts([robot, *moved], self.problem.plans)
        stacked = [np.stack(paths) for paths in zip(*driven, strict=True)]
        parts = [np.eye(unknowns.size)]
        for group in groups:
            rows: list[Array] = []
            for index in group.runs:
                run = self.problem.runs[index]
                recording = run.flat.recording
                setting, delay_s = settings[recording], float(delays_s[index])
                paths = stacked[self.problem.which[index]]
                found = predicted(run, paths, setting, delay_s)
                by_name = (found[1:] - found[0]) / (STEP * np.array(signs)[:, None, None])
                by_setting = jacobians(run, paths[0], setting, delay_s, robot.track_m).settings
                chosen, places = self._unknowns.chosen_settings(recording)
                mine = np.zeros((unknowns.size, by_name.shape[-2] * by_name.shape[-1]))
                mine[: len(names)] = self._whiten(index, by_name)
                scaled = by_setting[chosen] * SETTING_SPREAD[chosen][:, None, None]
                mine[places] = self._whiten(index, scaled)
                rows += [-mine.T, np.zeros((len(NUISANCE), unknowns.size))]
            rows.append(np.zeros((len(MISFIT), unknowns.size)))
            parts.append(group.nuisance.project_out(np.concatenate(rows)))
        return np.concatenate(parts)

    def _state(
        self, unknowns: Array, groups: Sequence[_ManeuverGroup], delays_s: Array
    ) -> tuple[State, tuple[Array, ...]]:
        nuisance = np.zeros((len(self.problem.runs), len(NUISANCE)))
        misfit: dict[str, Array] = {}
        residuals: list[Array] = [np.zeros(0)] * len(nuisance)
        whitened = self._whitened_residuals(unknowns, groups, delays_s)
        for group, rows in zip(groups, whitened, strict=True):
            shared, solved = group.nuisance.solve(rows)
            misfit[self.problem.runs[group.runs[0]].maneuver] = shared
            left = group.nuisance.project_out(rows)
            for block, index, mine in zip(group.nuisance.blocks, group.runs, solved, strict=True):
                nuisance[index] = mine + np.array([0, 0, 0, delays_s[index]])
                of_run = left[block.rows][: -len(NUISANCE)].reshape(3, -1)
                residuals[index] = self._whiteners[index].undo(of_run)
        robot, settings = self._unknowns.robot(unknowns), self._unknowns.settings(unknowns)
        return State(robot, settings, nuisance, misfit), tuple(residuals)

    def _solution(
        self, state: State, cost: float, jacobian: Array, residuals: tuple[Array, ...]
    ) -> Solution:
        covariance = np.asarray(np.linalg.inv(jacobian.T @ jacobian), np.float64)
        count = len(self._unknowns.names)
        setting_sd = np.zeros(self.problem.guess.size)
        free = np.flatnonzero(self.problem.free.ravel())
        setting_sd[free] = np.sqrt(np.diag(covariance)[count:])
        return Solution(
            state,
            cost,
            covariance[:count, :count],
            setting_sd.reshape(self.problem.guess.shape) * SETTING_SPREAD,
            residuals,
        )

    def evaluate(self, state: State) -> Solution:
        """The same state with the covariance that this solver's variances and noise make of it."""
        delays_s, groups = state.nuisance[:, NUISANCE.index("delay")], self._groups(state)
        unknowns = self._unknowns.of(state)
        cost = 0.5 * float((self._residuals(unknowns, groups, delays_s) ** 2).sum())
        jacobian = self._jacobian(unknowns, groups, delays_s)
        _, residuals = self._state(unknowns, groups, delays_s)
        return self._solution(state, cost, jacobian, residuals)


def initial_state(problem: Problem, robot: RobotParameters) -> State:
    """The state before anything is fitted."""
    runs = len(problem.runs)
    return State(robot, problem.guess.copy(), np.zeros((runs, len(NUISANCE))), {})
