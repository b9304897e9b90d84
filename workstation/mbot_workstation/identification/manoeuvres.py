"""The same manoeuvre driven several times: how its path changes is simulated only once."""

from collections.abc import Sequence

import numpy as np

from mbot_workstation.identification.parameters import BY_NAME, value, with_values
from mbot_workstation.identification.run_view import RunView, simulate_views
from mbot_workstation.identification.twist import Twists, twists_of
from mbot_workstation.recordings.track import Array
from mbot_workstation.simulation.robot_parameters import RobotParameters

STRENGTHS = ("left_gain", "right_gain")

ALIKE_S = 0.02
"""Commands that change at moments this close are the same manoeuvre."""


class Manoeuvres:
    """Runs sorted by what they were told."""

    def __init__(self, views: Sequence[RunView]) -> None:
        plans: list[tuple[str, Array]] = []
        self._of: list[int] = []
        self._longest: list[RunView] = []
        for view in views:
            what, when = view.plan
            same = (
                index
                for index, (other, moments) in enumerate(plans)
                if what == other and np.allclose(when, moments, rtol=0, atol=ALIKE_S)
            )
            index = next(same, len(plans))
            if index == len(plans):
                plans.append((what, when))
                self._longest.append(view)
            self._of.append(index)
            if view.steps > self._longest[index].steps:
                self._longest[index] = view

    def twists(self, robot: RobotParameters, names: Sequence[str]) -> list[Twists]:
        """For each run, by the motors' strengths (2) and then by these parameters."""
        nudges = [_nudged(robot, name) for name in (*STRENGTHS, *names)]
        robots = [robot, *(nudged for nudged, _ in nudges)]
        units = np.array([size for _, size in nudges])
        units[:2] /= [value(robot, name) for name in STRENGTHS]
        paths = simulate_views(
            [view for view in self._longest for _ in robots],
            robots * len(self._longest),
            [np.zeros(view.deviations) for view in self._longest for _ in robots],
        )
        found: list[Twists] = []
        for first in range(0, len(paths), len(robots)):
            path, *others = paths[first : first + len(robots)]
            found.append(twists_of(path, (np.array(others) - path) / units[:, None, None]))
        return [found[index] for index in self._of]


def _nudged(robot: RobotParameters, name: str) -> tuple[RobotParameters, float]:
    parameter = BY_NAME[name]
    here, nudge = value(robot, name), parameter.step_share * parameter.spread
    if here + nudge > parameter.high:
        nudge = -nudge
    return with_values(robot, {name: here + nudge}), nudge
