"""The memory that a vectorised environment and its workers share: no frame is ever pickled."""

import ctypes
import math
from dataclasses import dataclass
from multiprocessing.context import SpawnContext
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbot_protocol.policy_contract import OBSERVATION_SIDE_PX
from mbot_workstation.training.worlds.robot_body import BODY_RECORD

FRAME_SHAPE = (OBSERVATION_SIDE_PX, OBSERVATION_SIDE_PX, 3)

STEP_RECORD = np.dtype(
    [
        ("reward", np.float32),
        ("ended", np.bool_),
        ("happening", np.uint8),
        ("touches", np.int32),
        ("time_left_s", np.float32),
        ("target_ahead_m", np.float32),
        ("target_left_m", np.float32),
        ("seen_left_rad", np.float32),
        ("lesson", np.int32),
    ]
)
"""What a step of one robot brought: `Outcome` and `fetch_info`, the enumeration and the lesson by
number."""


@dataclass(frozen=True, slots=True)
class SharedMemory:
    """Raw memory, to be handed to a process when it is started.

    Attributes:
        robots: how many robots it holds places for.
        actions, frames, last_frames, records, first_records, bodies: see SharedArrays.

    """

    robots: int
    actions: Any
    frames: Any
    last_frames: Any
    records: Any
    first_records: Any
    bodies: Any

    @classmethod
    def allocate(cls, context: SpawnContext, robots: int) -> "SharedMemory":
        """Memory for so many robots; it goes when the last process that holds it does."""
        frame_bytes = robots * math.prod(FRAME_SHAPE)
        return cls(
            robots=robots,
            actions=context.RawArray(ctypes.c_float, robots * 2),
            frames=context.RawArray(ctypes.c_uint8, frame_bytes),
            last_frames=context.RawArray(ctypes.c_uint8, frame_bytes),
            records=context.RawArray(ctypes.c_uint8, robots * STEP_RECORD.itemsize),
            first_records=context.RawArray(ctypes.c_uint8, robots * STEP_RECORD.itemsize),
            bodies=context.RawArray(ctypes.c_uint8, robots * BODY_RECORD.itemsize),
        )

    def arrays(self) -> "SharedArrays":
        """The memory as arrays, in this process."""
        frames = (self.robots, *FRAME_SHAPE)
        return SharedArrays(
            actions=np.frombuffer(self.actions, np.float32).reshape(self.robots, 2),
            frames=np.frombuffer(self.frames, np.uint8).reshape(frames),
            last_frames=np.frombuffer(self.last_frames, np.uint8).reshape(frames),
            records=np.frombuffer(self.records, STEP_RECORD),
            first_records=np.frombuffer(self.first_records, STEP_RECORD),
            bodies=np.frombuffer(self.bodies, BODY_RECORD),
        )


@dataclass(frozen=True, slots=True)
class SharedArrays:
    """One row for each robot.

    Attributes:
        actions: float32, shape (n, 2); written by the environment.
        frames: uint8, shape (n, 64, 64, 3), observations; the rest is written by the workers.
        last_frames: the same for the last observations of episodes that have just ended.
        records: STEP_RECORD, shape (n,), of the last step.
        first_records: the same for the start of the running episodes.
        bodies: BODY_RECORD, shape (n,), of the running episodes.

    """

    actions: NDArray[np.float32]
    frames: NDArray[np.uint8]
    last_frames: NDArray[np.uint8]
    records: NDArray[np.void]
    first_records: NDArray[np.void]
    bodies: NDArray[np.void]
