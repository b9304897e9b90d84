"""The robot's monotonic clock, seen from here."""

import time
from collections.abc import Callable
from dataclasses import dataclass

from mbot_workstation.fleet.link.robot_link import RobotLink

SAMPLES = 8
"""The fastest of so many replies counts: a Wi-Fi reply mostly takes 2 ms and sometimes 50."""


@dataclass(frozen=True, slots=True)
class RobotTime:
    """How the clocks lie to each other. They drift by up to 0.1 ms a second, so ask often.

    Attributes:
        ahead_ns: the robot's monotonic clock minus this machine's.
        uncertainty_ns: the true value is within this to either side.

    """

    ahead_ns: int
    uncertainty_ns: int

    def robot_s(self, here_ns: int) -> float:
        """The robot's clock at a moment of this machine's monotonic clock."""
        return (here_ns + self.ahead_ns) / 1e9


def measure_robot_time(
    link: RobotLink, samples: int = SAMPLES, monotonic_ns: Callable[[], int] = time.monotonic_ns
) -> RobotTime:
    """Ask the robot for its time; the reply was written somewhere between asking and receiving.

    Raises:
        UnreachableError, RefusedError, ...: as `RobotLink.query`.

    """
    measured: list[RobotTime] = []
    for _ in range(samples):
        asked_ns = monotonic_ns()
        robot_ns = link.status().now_monotonic_ns
        heard_ns = monotonic_ns()
        half_ns = (heard_ns - asked_ns) // 2
        measured.append(RobotTime(robot_ns - asked_ns - half_ns, half_ns))
    return min(measured, key=lambda one: one.uncertainty_ns)
