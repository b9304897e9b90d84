"""All runs as one small linear problem, in which what runs have to themselves is solved for."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from mbot_workstation.identification.run_slopes import slopes
from mbot_workstation.identification.run_terms import POSE, SETTING, Residual, Slopes
from mbot_workstation.identification.run_view import RunView, simulate_views
from mbot_workstation.identification.scatter import Scatter
from mbot_workstation.identification.twist import Twists
from mbot_workstation.recordings.track import Array
from mbot_workstation.simulation.robot_parameters import RobotParameters

FAR = 3.0
"""From this many standard deviations on, a bin counts linearly, not by its square (soft l1)."""

SETTING_SPREAD = np.array([0.3, 3e-4, 0.1, 0.1, 1.0])
"""How far from the first guess a recording's setting may be: only as a hold where the runs say
nothing, such as a drift of the clock over a single run."""


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """Everything the fit moves.

    Attributes:
        robot: with the parameters as they are now.
        settings: of each recording, see `run_terms.SETTING`; shape (recordings, 5).
        poses: of each run's start, shape (runs, 3).
        deviations: of each run.

    """

    robot: RobotParameters
    settings: Array
    poses: Array
    deviations: tuple[Array, ...]

    def changed(self, robot: RobotParameters) -> Self:
        """The same with another robot."""
        return replace(self, robot=robot)


@dataclass(frozen=True, slots=True, eq=False)
class Fixed:
    """What the fit leaves alone.

    Attributes:
        guess: the settings at first, shape (recordings, 5).
        free: which of them may move, same shape, 0 or 1.

    """

    guess: Array
    free: Array


@dataclass(frozen=True, slots=True, eq=False)
class Evaluation:
    """A state, simulated.

    Attributes:
        state: the state.
        paths: of each run, shape (steps + 1, 3).
        residuals: of each run.
        held_back: what the settings' distance from their guess costs.

    """

    state: State
    paths: tuple[Array, ...]
    residuals: tuple[Residual, ...]
    held_back: float

    def cost(self, views: Sequence[RunView], scatter: Scatter) -> float:
        """Half the sum of squares, softened."""
        total = self.held_back
        for view, residual, own in zip(views, self.residuals, self.state.deviations, strict=True):
            total += _soft_cost(residual.value / scatter.bins(residual))
            total += 0.5 * float(((own / scatter.own(view)) ** 2).sum())
        return total


@dataclass(frozen=True, slots=True, eq=False)
class Linearisation:
    """The normal equations of parameters and settings.

    Attributes:
        names: of the parameters.
        free: which of all unknowns are free, shape (n,), n = parameters + 5 a recording.
        information: shape (n, n).
        gradient: shape (n,).
        own: of each run: how pose and deviations move by themselves (m,) and with the common
            unknowns (m, n).
        unknown: of each run: which share of its variance each deviation keeps.

    """

    names: tuple[str, ...]
    free: np.ndarray
    information: Array
    gradient: Array
    own: tuple[tuple[Array, Array], ...]
    unknown: tuple[Array, ...]

    def covariance(self) -> Array:
        """Of parameters and settings; 0 for settings that are not free."""
        result = np.zeros_like(self.information)
        chosen = np.ix_(self.free, self.free)
        result[chosen] = np.linalg.pinv(self.information[chosen], hermitian=True)
        return result

    def of_parameters(self) -> Array:
        """The information on the parameters alone, whatever the settings."""
        count = len(self.names)
        settings = self.free.copy()
        settings[:count] = False
        mixed = self.information[:count][:, settings]
        inner = np.linalg.pinv(self.information[np.ix_(settings, settings)], hermitian=True)
        return self.information[:count, :count] - mixed @ inner @ mixed.T


def evaluate(views: Sequence[RunView], state: State, fixed: Fixed) -> Evaluation:
    """Simulate every run once."""
    paths = simulate_views(views, [state.robot] * len(views), state.deviations)
    residuals = tuple(
        view.residual(path, state.settings[view.flat.recording], pose, own)
        for view, path, pose, own in zip(views, paths, state.poses, state.deviations, strict=True)
    )
    off = (state.settings - fixed.guess) / SETTING_SPREAD
    return Evaluation(state, tuple(paths), residuals, 0.5 * float((off**2).sum()))


def linearise(
    views: Sequence[RunView],
    here: Evaluation,
    fixed: Fixed,
    scatter: Scatter,
    names: Sequence[str],
    twists: Sequence[Twists],
) -> Linearisation:
    """Set up the normal equations; `twists` of each run: motors' strengths, then `names`."""
    count, state = len(names), here.state
    information, gradient = _hold(state, fixed, count)
    own: list[tuple[Array, Array]] = []
    unknown: list[Array] = []
    for index, view in enumerate(views):
        recording, residual = view.flat.recording, here.residuals[index]
        where = state.settings[recording], state.poses[index], state.deviations[index]
        found = slopes(view, here.paths[index], twists[index], residual, *where)
        found.common[count:] *= fixed.free[recording][:, None, None]
        first = count + len(SETTING) * recording
        columns = np.concatenate([np.arange(count), np.arange(first, first + len(SETTING))])
        part = _eliminate(view, residual, found, state.deviations[index], scatter)
        information[np.ix_(columns, columns)] += part.information
        gradient[columns] += part.gradient
        follow = np.zeros((len(part.offset), gradient.size))
        follow[:, columns] = part.follow
        own.append((part.offset, follow))
        unknown.append(part.unknown)
    free = np.concatenate([np.ones(count), fixed.free.ravel()]) > 0
    return Linearisation(tuple(names), free, information, gradient, tuple(own), tuple(unknown))


@dataclass(frozen=True, slots=True, eq=False)
class _RunPart:
    information: Array
    gradient: Array
    offset: Array
    follow: Array
    unknown: Array


def _eliminate(
    view: RunView, residual: Residual, found: Slopes, deviation: Array, scatter: Scatter
) -> _RunPart:
    """A run's part in the normal equations, with its pose and deviations solved for."""
    sd, prior = scatter.bins(residual), scatter.own(view)
    z = residual.value / sd
    weight = (1 + (z / FAR) ** 2) ** -0.25
    # The deviations in units of their standard deviation, so that they are pulled with 1.
    unit = np.concatenate([np.ones(POSE), prior])
    pull = np.concatenate([np.full(POSE, 1e-9), np.ones(len(prior))])
    common = (found.common / sd * weight).reshape(len(found.common), -1)
    own = np.concatenate([found.pose, found.own]) / sd * weight
    own = own.reshape(len(unit), -1) * unit[:, None]
    aim = (z * weight).ravel()
    size = np.concatenate([np.zeros(POSE), deviation / prior])
    inner = own @ own.T + np.diag(pull)
    cross = own @ common.T
    solved = np.linalg.solve(inner, np.column_stack([own @ aim - pull * size, cross]))
    return _RunPart(
        common @ common.T - cross.T @ solved[:, 1:],
        common @ aim - cross.T @ solved[:, 0],
        solved[:, 0] * unit,
        solved[:, 1:] * unit[:, None],
        np.asarray(np.diag(np.linalg.inv(inner))[POSE:], np.float64),
    )


def _soft_cost(z: Array) -> float:
    return float((FAR**2 * (np.sqrt(1 + (z / FAR) ** 2) - 1)).sum())


def _hold(state: State, fixed: Fixed, count: int) -> tuple[Array, Array]:
    pull = np.tile(SETTING_SPREAD**-2, len(fixed.guess))
    information = np.diag(np.concatenate([np.zeros(count), pull]))
    gradient = np.concatenate([np.zeros(count), -pull * (state.settings - fixed.guess).ravel()])
    return information, gradient
