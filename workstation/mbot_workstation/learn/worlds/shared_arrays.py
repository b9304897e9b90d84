"""The memory that a vectorised environment and its workers share: no frame is ever pickled."""

import ctypes
import math
from dataclasses import dataclass
from multiprocessing.context import SpawnContext
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbot_protocol.policy.policy_contract import OBSERVATION_SIDE_PX
from mbot_workstation.sim.effects.body_record import BODY_RECORD
from mbot_workstation.tasks.task import Task

FRAME_SHAPE = (OBSERVATION_SIDE_PX, OBSERVATION_SIDE_PX, 3)

SEGMENT = 32
"""Decisions in a row, at most, whose pictures are kept: 0.3 s of two cores, for which nobody waits
for anybody."""

SLOTS = 2
"""So many segments: what one was about is read while robots drive the next."""

_STEP = [
    ("reward", np.float32),
    ("ended", np.bool_),
    ("happening", np.uint8),
    ("lesson", np.int32),
]


def step_record(task: Task) -> "np.dtype[np.void]":
    """What a step of one robot brought: its `Outcome`, the lesson by number, the task's facts."""
    return np.dtype([*_STEP, *task.facts.descr])


@dataclass(frozen=True, slots=True)
class SharedMemory:
    """Raw memory, to be handed to a process when it is started.

    Attributes:
        robots: how many robots it holds places for.
        record: of a step: `step_record`.
        actions, frames, last_frames, records, now, bodies, segments: see SharedArrays.

    """

    robots: int
    record: "np.dtype[np.void]"
    actions: Any
    frames: Any
    last_frames: Any
    records: Any
    now: Any
    bodies: Any
    segments: Any

    @classmethod
    def allocate(cls, context: SpawnContext, robots: int, task: Task) -> "SharedMemory":
        """Memory for so many robots; it goes when the last process that holds it does."""
        record = step_record(task)
        frame_bytes = robots * math.prod(FRAME_SHAPE)
        return cls(
            robots=robots,
            record=record,
            actions=context.RawArray(ctypes.c_float, robots * 2),
            frames=context.RawArray(ctypes.c_uint8, frame_bytes),
            last_frames=context.RawArray(ctypes.c_uint8, frame_bytes),
            records=context.RawArray(ctypes.c_uint8, robots * record.itemsize),
            now=context.RawArray(ctypes.c_uint8, robots * record.itemsize),
            bodies=context.RawArray(ctypes.c_uint8, robots * BODY_RECORD.itemsize),
            segments=context.RawArray(ctypes.c_uint8, SLOTS * SEGMENT * frame_bytes),
        )

    def arrays(self) -> "SharedArrays":
        """The memory as arrays, in this process."""
        frames = (self.robots, *FRAME_SHAPE)
        return SharedArrays(
            actions=np.frombuffer(self.actions, np.float32).reshape(self.robots, 2),
            frames=np.frombuffer(self.frames, np.uint8).reshape(frames),
            last_frames=np.frombuffer(self.last_frames, np.uint8).reshape(frames),
            records=np.frombuffer(self.records, self.record),
            now=np.frombuffer(self.now, self.record),
            bodies=np.frombuffer(self.bodies, BODY_RECORD),
            segments=np.frombuffer(self.segments, np.uint8).reshape(SLOTS, SEGMENT, *frames),
        )


@dataclass(frozen=True, slots=True)
class SharedArrays:
    """One row for each robot.

    Attributes:
        actions: float32, shape (n, 2); written by the environment, or by a worker's pilot.
        frames: uint8, shape (n, 64, 64, 3), observations; the rest is written by the workers.
        last_frames: the same for the last observations of episodes that have just ended.
        records: the step record, shape (n,), of the last step.
        now: the same for what is seen now: of the start of an episode that has just begun.
        bodies: BODY_RECORD, shape (n,), of the running episodes.
        segments: uint8, shape (SLOTS, SEGMENT, n, 64, 64, 3), what pilots have seen.

    """

    actions: NDArray[np.float32]
    frames: NDArray[np.uint8]
    last_frames: NDArray[np.uint8]
    records: NDArray[np.void]
    now: NDArray[np.void]
    bodies: NDArray[np.void]
    segments: NDArray[np.uint8]
