"""A driver to learn from: it is told what the robot is like, and where the object is while seen.

The oracle cannot be imitated: it turns straight to objects behind the robot, which no picture
shows. The guide does what a policy with a memory could do: turn clockwise until the object comes
into view, as the paper's policy does, then drive as the oracle would, also for a while after it
was lost from sight. What has the object's colour and is too far away to be told from it, it drives
to until it can be: so its student goes and looks, and need not know what no picture shows. However
long it searches, it turns on and stays where it is: where there is no
object, or a table ends, nothing tells a robot where it could look instead. So it needs eyes that
reach 5 m, across the arena; whoever sees 2.8 m misses objects in half of the episodes and more
(`test_guidance.py`). Nor does it stand still between turns, for pictures without blur: who has lost
count does half of both, too little to turn a worn robot (seen in failed searches of a policy that
was taught so). Nor does it choose a side, towards the middle of the arena: that saves the guide
half a decision an object, but who was taught so turned to and fro at walls and had not made up for
it after 450,560 decisions (docs/notebook/training.md).

It asks for full speed and the turn on top of it: the wheels keep the turn and give way together
(`learning/full_speed.py`).
"""

import numpy as np
from numpy.typing import NDArray

from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.effects.effects import EffectRanges
from mbot_workstation.tasks.fetch.episode import IN_VIEW_RAD
from mbot_workstation.tasks.fetch.oracle import Actions, Oracle, middle

SEARCH_SPEED = 0.32
"""Of both wheels in the search turn, share of full speed: about 47 degrees a decision, so that the
object is in at least one picture of 55 degrees."""

SEARCH_BEGINS = 1.5
"""Times as fast in the first decision of a turn, in which wheels only begin to follow: it turned
31 degrees. Driving by itself the guide takes 15.9 decisions an object so, not 16.2 (nominal, 384
episodes that 0.32 and 1.5 were not chosen by)."""


class FetchGuide:
    """Drives a number of robots.

    Args:
        remembers: decisions for which it goes by an object that has left the view and was noticed;
            0 for a policy without memory.

    """

    def __init__(
        self,
        robots: int,
        preset: EffectRanges,
        nominal: RobotParameters | None = None,
        remembers: int = 0,
    ) -> None:
        self._oracle = Oracle(robots, middle(preset), nominal)
        self._remembers = remembers
        self._unseen_for = np.full(robots, remembers + 1)
        self._noticed = self._goes = np.zeros(robots, np.bool_)
        self._time_left_s = np.full(robots, -np.inf)
        self._driven = self._blind = np.zeros((robots, 2), np.float32)

    def become(self, bodies: NDArray[np.void]) -> None:
        """Say what the robots are like: BODY_RECORD, shape (robots,)."""
        self._oracle.become(bodies)

    def act(self, facts: NDArray[np.void]) -> Actions:
        """Both wheels of every robot, shape (robots, 2).

        In shares of full speed, up to 2 where a turn comes on top of it. NaN for robots whose
        target is unknown, or whose picture still shows the one that they have touched.

        Args:
            facts: FACTS, shape (robots,). Where observations show the objects counts,
                though a robot may have turned past one since.

        """
        targets = np.stack([facts["aim_ahead_m"], facts["aim_left_m"]], axis=1)
        seen, stale = _in_view(facts), np.isnan(facts["seen_left_rad"])
        another = facts["time_left_s"] > self._time_left_s  # each object has its own time
        self._time_left_s = facts["time_left_s"].copy()
        self._noticed &= ~another
        self._unseen_for[~self._noticed] = self._remembers + 1
        self._unseen_for = np.where(seen, 0, self._unseen_for + 1)
        lost = self._unseen_for > self._remembers
        suspects = np.stack([facts["suspect_ahead_m"], facts["suspect_left_m"]], axis=1)
        suspects[stale | np.isnan(targets[:, 0])] = np.nan
        self._goes = lost & np.isfinite(suspects[:, 0])
        self._noticed &= ~lost
        lost &= ~self._goes
        aims = np.where(lost[:, None], np.nan, targets)
        aims[self._goes] = suspects[self._goes]
        last_turn = self._oracle.last_turn
        actions = self._oracle.act(aims.astype(np.float64))
        begins = last_turn > -SEARCH_SPEED  # clockwise is negative, of both wheels together
        turn = np.where(begins, SEARCH_BEGINS * SEARCH_SPEED, SEARCH_SPEED)
        blind = self._oracle.commands(turn, -turn)
        actions[lost] = blind[lost]
        actions[np.isnan(targets[:, 0]) | stale] = np.nan
        self._driven, self._blind = actions, blind
        at_full_speed = actions + 1 - actions.mean(axis=1, keepdims=True)
        return np.where(lost[:, None], actions, at_full_speed)

    def shows(self, facts: NDArray[np.void]) -> NDArray[np.bool_]:
        """Whether each picture shows the object, or what may be it; FACTS, shape (n,)."""
        return _in_view(facts) | np.isfinite(facts["suspect_ahead_m"])

    def forget(self, who: NDArray[np.bool_]) -> None:
        """These, shape (robots,), remember no object from now on."""
        self._noticed &= ~who

    def drove(self, actions: Actions) -> None:
        """Say what was done instead: wheels lag, so the next advice depends on it.

        An object that passes through a picture of the search turn, far away and blurred, may go
        unnoticed: who searches on can't be told to go back to it.
        """
        self._oracle.drove(actions)
        went = _distance(actions, self._driven) < _distance(actions, self._blind)
        self._noticed |= went & ~self._goes


def _in_view(facts: NDArray[np.void]) -> NDArray[np.bool_]:
    return np.abs(facts["seen_left_rad"]) <= IN_VIEW_RAD


def _distance(one: Actions, other: Actions) -> NDArray[np.float32]:
    """Between commands of each robot, shape (robots,)."""
    return np.abs(one - other).sum(axis=1)
