"""Is a motor weaker backward, is the robot dragged in turns? Taken in only where it shows.

Most robots have neither, and a fit that looked for both in every recording would know everything
else less well. Without them motors seem to differ in strength from manoeuvre to manoeuvre; where
that is explained clearly better with them, they are there.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mbot_workstation.identification.linearisation import State
from mbot_workstation.identification.mixed_fit import MixedFit, Progress, begin
from mbot_workstation.identification.parameters import value, with_values
from mbot_workstation.identification.run_terms import SIDES, STRENGTH
from mbot_workstation.recordings.track import Array

BACKWARD = ("left_backward_share", "right_backward_share")
DRAG = ("turning_drag_n_m",)
EXTRAS = (*BACKWARD, *DRAG)

CLEARLY = 8.0
"""By how much the logarithm of the runs' likelihood has to rise: 4 standard deviations."""

WIDE_ROUNDS, HELD_ROUNDS, ROUNDS = 4, 12, 6
ALL_ROUNDS = WIDE_ROUNDS + HELD_ROUNDS + ROUNDS

LIKELY_DRAG_N_M = 0.005
"""Where the search for drag begins: half of what a caster with 0.15 N of friction makes."""

LOAD = 0.003
"""By as much runs differ in the strength of both motors alike where nothing is left to explain:
0.003 to 0.005 came out for the planar robots of the tests."""


def look_for_extras(
    fit: MixedFit, names: Sequence[str], progress: Progress | None = None
) -> tuple[str, ...]:
    """Try them on a finished fit, and leave the fit with those that are there.

    Returns:
        Their names.

    """
    found: tuple[str, ...] = ()
    for extra in (BACKWARD, DRAG):
        start = _told_apart(fit) if extra == BACKWARD else _dragged(fit)
        trial = MixedFit(fit.views, fit.fixed, start)
        every = [*names, *found, *extra]
        trial.run(every, WIDE_ROUNDS, progress, learn=False)
        # Narrow and held, so that what the new parameter may explain is not left to the scatter.
        trial.scatter = replace(fit.scatter, load=min(fit.scatter.load, LOAD))
        trial.run(every, HELD_ROUNDS, progress, learn=False)
        trial.run(every, ROUNDS, progress)
        if _likelier(fit, trial) >= CLEARLY:
            fit.here, fit.scatter = trial.here, trial.scatter
            found = (*found, *extra)
    return found


def _likelier(before: MixedFit, after: MixedFit) -> float:
    """By how much the logarithm of the runs' likelihood has risen, about.

    Where manoeuvres were repeated, what one gets wrong every time costs, and costs less now. Where
    they were not, it is taken for the scatter of motors' strengths, which is narrower now: the
    likelier is every one that is drawn from it.
    """
    cheaper = before.cost - after.here.cost(after.views, before.scatter)
    own = 2 * math.log(before.scatter.strength / after.scatter.strength)
    both = math.log(before.scatter.load / after.scatter.load)
    return max(cheaper, len(before.views) * (own + both))


def _told_apart(fit: MixedFit) -> State:
    """The state in which what motors differ forward and backward is no run's own any more."""
    ways = [_ways(view.flat.run.commands.left, view.flat.run.commands.right) for view in fit.views]
    state = fit.state
    totals = [own[STRENGTH] + own[SIDES] for own in state.deviations]
    mean = np.zeros((2, 3))  # by side; of neither way 0, forward 1, backward -1
    for side in (0, 1):
        for sign in (1, -1):
            mine = [t[side] for t, way in zip(totals, ways, strict=True) if way[side] == sign]
            mean[side, sign] = np.mean(mine) if mine else 0.0
    robot = state.robot
    changes: dict[str, float] = {}
    for side, name in enumerate(("left", "right")):
        forward, backward = 1 + mean[side, 1], 1 + mean[side, -1]
        changes[f"{name}_gain"] = value(robot, f"{name}_gain") * forward
        share = value(robot, f"{name}_backward_share")
        changes[f"{name}_backward_share"] = share * backward / forward
    deviations = [
        _without(own, [mean[side, way[side]] for side in (0, 1)])
        for own, way in zip(state.deviations, ways, strict=True)
    ]
    return replace(state, robot=with_values(robot, changes), deviations=tuple(deviations))


def _dragged(fit: MixedFit) -> State:
    """The state with some drag, and with no run stronger or weaker than another any more."""
    robot = with_values(fit.state.robot, {DRAG[0]: LIKELY_DRAG_N_M})
    return begin(fit.views, robot, fit.state.settings)


def _without(own: Array, explained: Sequence[float]) -> Array:
    """A run's deviations without a part of its motors' strengths."""
    result = own.copy()
    left = own[STRENGTH] + own[SIDES] - explained
    result[STRENGTH] = left.mean()
    result[SIDES] = left - left.mean()
    return result


def _ways(left: Array, right: Array) -> tuple[int, int]:
    """In which direction each motor is driven; 0 if it is not, or in both."""
    signs = [{int(np.sign(action)) for action in side if action} for side in (left, right)]
    one, other = (next(iter(some)) if len(some) == 1 else 0 for some in signs)
    return one, other
