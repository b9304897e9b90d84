"""A driver to learn from: it is told where the object is, but only while the camera can see it.

The oracle cannot be imitated: it turns straight to objects behind the robot, which no picture
shows. The guide does what a policy without memory could do: turn clockwise until the object comes
into view, as the paper's policy does, then drive as the oracle would.
"""

import math

import numpy as np
from numpy.typing import NDArray

from mbot_workstation.simulation.robot_parameters import RobotParameters
from mbot_workstation.training.drivers.onnx_policy import Actions
from mbot_workstation.training.drivers.oracle import Oracle, Targets, middle
from mbot_workstation.variation.effects import EffectRanges

SEARCH_TURN = 0.30
"""Wheels of the search turn, share of full speed: about 40 degrees a decision on the nominal robot,
so that the object is in at least one picture of 55 degrees."""

IN_VIEW_RAD = math.radians(27.0)
"""Half the camera's horizontal field of view."""


class Guide:
    """Drives a number of robots; see `Oracle` for what it is told."""

    def __init__(
        self, robots: int, preset: EffectRanges, nominal: RobotParameters | None = None
    ) -> None:
        nominal = nominal or RobotParameters()
        self._oracle = Oracle(robots, middle(preset), nominal)

    def act(self, targets: Targets, seen_left_rad: NDArray[np.float64]) -> Actions:
        """Both wheels of every robot, shape (robots, 2); NaN for robots whose target is unknown.

        Args:
            targets: where the objects are now.
            seen_left_rad: where the observations show them, shape (robots,): what a picture shows
                at its edge counts, though the robot may have turned past it since.

        """
        ahead = targets[:, 0]
        unseen = np.abs(seen_left_rad) > IN_VIEW_RAD
        known = np.where(unseen[:, None], np.nan, targets)
        actions = self._oracle.act(known)
        actions[unseen] = (SEARCH_TURN, -SEARCH_TURN)
        actions[np.isnan(ahead)] = np.nan
        return actions

    def drove(self, actions: Actions) -> None:
        """Say what was done instead: wheels lag, so the next advice depends on it."""
        self._oracle.drove(actions)
