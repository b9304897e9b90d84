"""Somebody who carries the robot back to the middle between two maneuvers."""

from mbot_workstation.sim.pose import Pose

STANDING_S = 1.5
"""So long must it have stood: longer than the second of standing that belongs to a run's end."""

NEAR_M = 0.3
"""Not worth carrying."""


class CarryBack:
    """Decides when the robot is carried."""

    def __init__(self) -> None:
        self._stood_s = 0.0

    def is_due(self, *, driven: bool, pose: Pose, elapsed_s: float) -> bool:
        """Whether it is carried now.

        Args:
            driven: whether its motors turn.
            pose: where it is.
            elapsed_s: since the last call.

        """
        self._stood_s = 0.0 if driven else self._stood_s + elapsed_s
        if self._stood_s < STANDING_S or max(abs(pose.x_m), abs(pose.y_m)) < NEAR_M:
            return False
        self._stood_s = 0.0
        return True
