"""Records a SteamVR tracker 90 times a second."""

import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

from mbot_workstation.measure.tracking.track_file import TrackFile
from mbot_workstation.pacer import Pacer
from mbot_workstation.sim.track import Array


class PoseSource(Protocol):
    """Something that knows where the tracker is."""

    def pose(self) -> tuple[Array, Array] | None:
        """Position (3,) and attitude (4,), z up; None while lost."""
        ...


@dataclass(frozen=True, slots=True)
class Progress:
    """How it goes.

    Attributes:
        recorded, lost: poses so far; lost ones are left out of the file.
        lost_for_s: how long the tracker has been lost now; 0: it is seen.

    """

    recorded: int
    lost: int
    lost_for_s: float


def record_poses(
    source: PoseSource, file: TrackFile, rate_hz: float, stop: threading.Event
) -> Iterator[Progress]:
    """Record until stopped; yields after every pose. Times are this machine's monotonic clock."""
    pacer = Pacer(1 / rate_hz, 1)
    lost = 0
    seen_s = time.monotonic()
    while pacer.wait(stop) > 0:
        now_s = time.monotonic()
        pose = source.pose()
        if pose is None:
            lost += 1
        else:
            seen_s = now_s
            file.add(now_s, *pose)
        yield Progress(file.poses, lost, now_s - seen_s)
