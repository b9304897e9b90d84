"""The last moments of the simulation, for a camera that exposes for a while."""

import threading
from collections import deque

from mbot_workstation.simulation.simulation import SceneState

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

    def exposure(self, duration_s: float, moments: int) -> list[SceneState]:
        """Moments evenly spread over the last `duration_s`, oldest first."""
        with self._lock:
            kept = list(self._moments)
        end_s = kept[-1][0]
        spread = [(index + 0.5) / moments * duration_s for index in reversed(range(moments))]
        return [min(kept, key=lambda moment: abs(end_s - age_s - moment[0]))[1] for age_s in spread]
