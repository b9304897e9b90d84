"""The last moments of the simulation, for a camera that exposes for a while."""

import math
import threading
from collections import deque

from mbot_workstation.sim.simulation import SceneState

KEPT_S = 0.2
"""Longer than any exposure."""


class SceneHistory:
    """Moments with their times, written by the physics thread and read by the camera's."""

    def __init__(self, slice_s: float) -> None:
        self._moments: deque[tuple[float, SceneState]] = deque(maxlen=round(KEPT_S / slice_s))
        self._lock = threading.Lock()

    def add(self, time_s: float, state: SceneState) -> None:
        """Append the newest moment; times rise."""
        with self._lock:
            self._moments.append((time_s, state))

    def newest(self) -> SceneState:
        """The last moment."""
        with self._lock:
            return self._moments[-1][1]

    def around(self, time_s: float) -> tuple[tuple[float, SceneState], tuple[float, SceneState]]:
        """The moments before and after, with their times; the first or last two beyond those.

        Raises:
            LookupError: there is only one moment yet.

        """
        with self._lock:
            kept = list(self._moments)
        if len(kept) < 2:
            raise LookupError("history has one moment, two are needed")
        after = next((i for i, (moment_s, _) in enumerate(kept) if moment_s >= time_s), len(kept))
        after = min(max(after, 1), len(kept) - 1)
        return kept[after - 1], kept[after]

    def glance(self, age_s: float) -> tuple[SceneState, float]:
        """The moment so long before the last one, and how fast the robot turned then.

        Returns:
            The nearest moment that is kept, and the turn rate in rad/s, positive to the left.

        """
        with self._lock:
            kept = list(self._moments)
        end_s = kept[-1][0]
        index = min(range(len(kept)), key=lambda i: abs(end_s - age_s - kept[i][0]))
        before, after = kept[max(index - 1, 0)], kept[min(index + 1, len(kept) - 1)]
        passed_s = after[0] - before[0]
        turned = math.remainder(_yaw_rad(after[1]) - _yaw_rad(before[1]), 2 * math.pi)
        return kept[index][1], turned / passed_s if passed_s > 0 else 0.0


def _yaw_rad(state: SceneState) -> float:
    w, x, y, z = state.joints[3:7].tolist()  # of the free joint
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
