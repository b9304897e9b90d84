"""The fit: Gauss-Newton over the robot, with every run's start and deviations beside it.

Half of what differs between a run and the simulation is no fault of the parameters: batteries,
floors and brushes vary from run to run and from second to second. So each run gets its own
deviations, which are pulled towards 0 with a strength that the runs themselves tell (a mixed-
effects model). That keeps a drive of 10 s, in which 1 % more speed on one side is 0.7 m, from
being explained by anything else, and makes the intervals honest: 80 runs of one bad day are not
80 times 900 independent samples.

The parameters change the path by MuJoCo itself, by finite differences over `mujoco.batch`; start
pose, clock and tracker do so in closed form. Everything a run has to itself is eliminated run by
run, so what is solved in the end is as small as the number of parameters.

`mujoco.sysid` does not fit: it knows no unknowns of a single run, of which there are 28 here, and
no random ones, so its intervals would be those of white noise; and it brings plotting, video and
HTML packages along. `scipy.optimize.least_squares` would need the whole Jacobian, 1 GB.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from mbot_workstation.identification.linearisation import (
    Evaluation,
    Fixed,
    Linearisation,
    State,
    evaluate,
    linearise,
)
from mbot_workstation.identification.manoeuvres import Manoeuvres
from mbot_workstation.identification.parameters import BY_NAME, value, with_values
from mbot_workstation.identification.run_terms import POSE, SETTING
from mbot_workstation.identification.run_view import RunView, simulate_views
from mbot_workstation.identification.scatter import Scatter, learn_scatter
from mbot_workstation.identification.twist import Twists
from mbot_workstation.recordings.track import Array
from mbot_workstation.simulation.robot_parameters import RobotParameters

LONGEST_STEP = 3.0
"""Of a parameter in one round, in spreads."""

SETTLED = 0.01
"""When no parameter moves by more, in spreads, it is found."""

WORTHWHILE = 0.002
"""A step that takes away less of the cost than this share is one of the last."""

NEARBY = 0.3
"""After a step of less, in spreads, paths change by parameters as they did before."""

FEWEST_ROUNDS = 4
"""The scatter, wide at first, needs some rounds to be learnt."""

SETTING_SCALE = np.array([0.05, 1e-4, 0.02, 0.02, 0.1])

Progress = Callable[[], None]


def begin(views: Sequence[RunView], robot: RobotParameters, settings: Array) -> State:
    """Every run at its start, without deviations. `settings` has shape (recordings, 5)."""
    deviations = tuple(np.zeros(view.deviations) for view in views)
    paths = simulate_views(views, [robot] * len(views), deviations)
    poses = [
        view.begin(path, settings[view.flat.recording])
        for view, path in zip(views, paths, strict=True)
    ]
    return State(robot, settings.copy(), np.array(poses), deviations)


class MixedFit:
    """Runs and how they are explained so far.

    Attributes:
        views: the runs.
        fixed: what is left alone.
        here: the state now.
        scatter: as it is now.

    """

    def __init__(
        self, views: Sequence[RunView], fixed: Fixed, state: State, scatter: Scatter | None = None
    ) -> None:
        self.views, self.fixed = tuple(views), fixed
        self.here: Evaluation = evaluate(self.views, state, fixed)
        self.scatter = scatter or Scatter()
        self._manoeuvres = Manoeuvres(views)
        self._twists: tuple[tuple[str, ...], list[Twists]] | None = None

    def branch(self, robot: RobotParameters) -> "MixedFit":
        """Another fit of the same runs, from here on but with a slightly different robot."""
        other = MixedFit(self.views, self.fixed, self.state.changed(robot), self.scatter)
        other._twists = self._twists
        return other

    @property
    def state(self) -> State:
        """As it is now."""
        return self.here.state

    @property
    def cost(self) -> float:
        """Half the sum of squares, softened."""
        return self.here.cost(self.views, self.scatter)

    def run(
        self,
        names: Sequence[str],
        rounds: int,
        progress: Progress | None = None,
        *,
        learn: bool = True,
    ) -> None:
        """Improve these parameters until they settle, or for so many rounds.

        Args:
            names: of the parameters to fit; none: only settings, poses and deviations.
            rounds: at most.
            progress: called after each.
            learn: the scatter too.

        """
        was_stuck = not names
        for count in range(1, rounds + 1):
            normal = self.linearise(names)
            largest, gain = self._improve(normal)
            stuck = largest == gain == 0
            if largest > NEARBY or stuck:
                self._twists = None
            if learn:
                self._learn(normal, about_maneuvers=True)
            if progress is not None:
                progress()
            settled = largest < SETTLED and gain < WORTHWHILE and not (stuck and not was_stuck)
            was_stuck = stuck
            if settled and count >= (FEWEST_ROUNDS if learn else 1):
                break

    def linearise(self, names: Sequence[str]) -> Linearisation:
        """The normal equations where the fit stands."""
        if self._twists is None or self._twists[0] != tuple(names):
            self._twists = tuple(names), self._manoeuvres.twists(self.state.robot, names)
        return linearise(self.views, self.here, self.fixed, self.scatter, names, self._twists[1])

    def judge(self, names: Sequence[str]) -> Linearisation:
        """The normal equations with all that a manoeuvre gets wrong counted as scatter."""
        for _ in range(2):  # what is scatter depends a little on how large it was thought
            self._learn(self.linearise(names), about_maneuvers=False)
        return self.linearise(names)

    def _learn(self, normal: Linearisation, *, about_maneuvers: bool) -> None:
        self.scatter = learn_scatter(
            self.views,
            self.here.residuals,
            self.state.deviations,
            normal.unknown,
            about_maneuvers=about_maneuvers,
        )

    def _improve(self, normal: Linearisation) -> tuple[float, float]:
        """One step downhill: the largest move of a parameter, in spreads, and the share of the
        cost that is gone.
        """
        count = len(normal.names)
        spreads = [BY_NAME[name].spread for name in normal.names]
        scale = np.concatenate([spreads, np.tile(SETTING_SCALE, len(self.fixed.guess))])
        free = normal.free.copy()
        move = _downhill(normal, scale, free)
        while (beyond := _out_of_limits(self.state.robot, normal.names, move)).any():
            free[:count] &= ~beyond  # the others are to make the best of its limit
            move = _downhill(normal, scale, free)
        largest = float(np.abs(move[:count]).max(initial=0))
        move *= scale * min(1.0, LONGEST_STEP / max(largest, 1e-9))
        before = self.cost
        for share in (1.0, 0.5, 0.2, 0.05):
            tried = evaluate(self.views, _moved(self.state, normal, move, share), self.fixed)
            cost = tried.cost(self.views, self.scatter)
            if cost <= before:
                self.here = tried
                return largest * share, 1 - cost / max(before, 1e-9)
        return 0.0, 0.0


def _downhill(normal: Linearisation, scale: Array, free: NDArray[np.bool_]) -> Array:
    """By how many of its `scale` each unknown goes; those that are not free stay."""
    information = (normal.information * np.outer(scale, scale))[np.ix_(free, free)]
    damping = 1e-6 * np.diag(np.diag(information)) + 1e-9 * np.eye(len(information))
    move = np.zeros(free.size)
    move[free] = np.linalg.solve(information + damping, (normal.gradient * scale)[free])
    return move


def _out_of_limits(robot: RobotParameters, names: Sequence[str], move: Array) -> NDArray[np.bool_]:
    """Which parameters are at a limit already and would go beyond it."""
    limits = [BY_NAME[name] for name in names]
    here = np.array([value(robot, name) for name in names])
    low = here <= np.array([one.low for one in limits])
    high = here >= np.array([one.high for one in limits])
    return (low & (move[: len(names)] < 0)) | (high & (move[: len(names)] > 0))


def _moved(start: State, normal: Linearisation, move: Array, share: float) -> State:
    values = {
        name: value(start.robot, name) + share * move[index]
        for index, name in enumerate(normal.names)
    }
    own = [share * (offset - follow @ move) for offset, follow in normal.own]
    settings = move[len(normal.names) :].reshape(-1, len(SETTING))
    return State(
        with_values(start.robot, values),
        start.settings + share * settings,
        start.poses + np.array([step[:POSE] for step in own]),
        tuple(old + step[POSE:] for old, step in zip(start.deviations, own, strict=True)),
    )
