"""A guide for tasks in the plane: the task says where to go next, and it drives there.

A task's facts name the place, `aim_ahead_m` and `aim_left_m` in the robot's frame; NaN is no advice
in this decision. The task must not name what a policy could not know: a student that can't see why
learns to guess. Driving is the oracle's (`fetch/oracle.py`): it knows what the robot is like, and
its wheels keep the turn where they can't have both (`learning/full_speed.py`).
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.effects.effects import EffectRanges
from mbot_workstation.tasks.fetch.oracle import Actions, Oracle, middle
from mbot_workstation.tasks.fetch.task import targets_in
from mbot_workstation.tasks.task import Expert

Facts = NDArray[np.void]


def aim_expert(robots: int, ranges: EffectRanges, robot: RobotParameters) -> Expert:
    """The same, told of the usual robot's place and not of what its pictures show."""
    oracle = Oracle(robots, middle(ranges), robot)
    return lambda infos: oracle.act(targets_in(infos))


class AimGuide:
    """Drives a number of robots to what their tasks name.

    Args:
        shows: of facts of any shape: whether the pictures show by themselves what the advice goes
            by, so that mirrored ones call for mirrored advice.

    """

    def __init__(
        self,
        robots: int,
        ranges: EffectRanges,
        nominal: RobotParameters,
        shows: Callable[[Facts], NDArray[np.bool_]],
    ) -> None:
        self._oracle = Oracle(robots, middle(ranges), nominal)
        self._shows = shows

    def become(self, bodies: NDArray[np.void]) -> None:
        """Say what the robots are like: BODY_RECORD, shape (robots,)."""
        self._oracle.become(bodies)

    def act(self, facts: Facts) -> Actions:
        """Both wheels of every robot, shape (robots, 2), in shares of full speed."""
        aims = np.stack([facts["aim_ahead_m"], facts["aim_left_m"]], axis=1).astype(np.float64)
        actions = self._oracle.act(aims)
        actions[np.isnan(aims[:, 0])] = np.nan
        return actions

    def forget(self, who: NDArray[np.bool_]) -> None:
        """It goes by nothing that it remembers."""

    def drove(self, actions: Actions) -> None:
        """Say what was done instead: wheels lag, so the next advice depends on it."""
        self._oracle.drove(actions)

    def shows(self, facts: Facts) -> NDArray[np.bool_]:
        """As the task says."""
        return self._shows(facts)
