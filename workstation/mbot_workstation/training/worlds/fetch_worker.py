"""A process that runs a share of the robots. It imports neither torch nor stable-baselines3."""

import signal
import traceback
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import assert_never

import cv2
import numpy as np

from mbot_workstation.simulation.fetch_task import Happening
from mbot_workstation.training.worlds.fetch_info import (
    HAPPENINGS,
    seen_left_rad,
    target_from_robot,
)
from mbot_workstation.training.worlds.fetch_world import FetchWorld, Outcome
from mbot_workstation.training.worlds.lessons import Lesson
from mbot_workstation.training.worlds.robot_eye import RobotEye
from mbot_workstation.training.worlds.shared_arrays import SharedArrays, SharedMemory
from mbot_workstation.training.worlds.world_settings import WorldSettings

NOTHING_YET = Outcome(0.0, Happening.NOTHING, ended=False)


@dataclass(frozen=True, slots=True)
class Step:
    """Carry out the actions in shared memory.

    Attributes:
        robots: whose; rows of the memory.

    """

    robots: range


@dataclass(frozen=True, slots=True)
class Reset:
    """Start new episodes.

    Attributes:
        seeds: for each of the worker's robots; None goes on with the random numbers it has.

    """

    seeds: tuple[int | None, ...]


@dataclass(frozen=True, slots=True)
class Teach:
    """Start episodes with another lesson from now on.

    Attributes:
        lesson: which.
        number: what records call it.

    """

    lesson: Lesson
    number: int


@dataclass(frozen=True, slots=True)
class Quit:
    """End."""


Request = Step | Reset | Teach | Quit


@dataclass(frozen=True, slots=True)
class Done:
    """The request has been carried out."""


@dataclass(frozen=True, slots=True)
class Failed:
    """It has not, and the worker has ended.

    Attributes:
        text: the traceback.

    """

    text: str


Reply = Done | Failed


def run_worker(pipe: Connection, memory: SharedMemory, robots: range) -> None:
    """Serve requests until told to quit or left alone.

    Args:
        pipe: WorldSettings in, then requests; a reply to each out, the first when the worlds are
            built.
        memory: shared.
        robots: which rows of the memory are this worker's.

    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # also if a thread has started it
    cv2.setNumThreads(1)  # small pictures: handing them to threads costs more than the work
    try:
        settings: WorldSettings = pipe.recv()
        with RobotEye(settings.rooms, settings.robot, settings.scene, settings.floors) as eye:
            share = _Share(eye, memory.arrays(), robots, settings)
            pipe.send(Done())
            while share.serve(pipe.recv()):
                pipe.send(Done())
    except (EOFError, BrokenPipeError):
        return  # the environment has gone
    except Exception:
        pipe.send(Failed(traceback.format_exc()))


class _Share:
    """The robots of one worker."""

    def __init__(
        self, eye: RobotEye, arrays: SharedArrays, robots: range, settings: WorldSettings
    ) -> None:
        self._eye, self._arrays, self._robots = eye, arrays, robots
        self._worlds = [FetchWorld(settings) for _ in robots]
        self._lesson, self._lesson_number = settings.lesson, 0
        self._episode_lesson = [0] * len(robots)

    def serve(self, request: Request) -> bool:
        """Carry a request out; False if it was the last one."""
        match request:
            case Step(robots):
                # All physics first, then all pictures: a processor's cache holds one of the two.
                for row in robots:
                    self._step(row - self._robots.start)
                self._observe(robots)
            case Reset(seeds):
                for index, seed in enumerate(seeds):
                    if seed is not None:
                        self._worlds[index].seed(np.random.default_rng(seed))
                    self._begin(index)
                self._observe(self._robots)
            case Teach(lesson, number):
                self._lesson, self._lesson_number = lesson, number
            case Quit():
                return False
            case _:
                assert_never(request)
        return True

    def _observe(self, robots: range) -> None:
        for row in robots:
            world = self._worlds[row - self._robots.start]
            self._arrays.frames[row] = self._eye.observe(world)

    def _step(self, index: int) -> None:
        world, row = self._worlds[index], self._robots[index]
        left, right = self._arrays.actions[row].tolist()
        outcome = world.decide(left, right)
        self._arrays.records[row] = self._record(index, outcome)
        self._arrays.bodies[row] = world.body
        if outcome.ended:
            self._arrays.last_frames[row] = self._eye.observe(world)
            self._begin(index)

    def _begin(self, index: int) -> None:
        self._worlds[index].begin(self._lesson)
        self._episode_lesson[index] = self._lesson_number
        row = self._robots[index]
        self._arrays.first_records[row] = self._record(index, NOTHING_YET)
        self._arrays.bodies[row] = self._worlds[index].body

    def _record(self, index: int, outcome: Outcome) -> tuple[float, ...]:
        world = self._worlds[index]
        return (
            outcome.reward,
            outcome.ended,
            HAPPENINGS.index(outcome.happening),
            world.touches,
            world.time_left_s,
            *target_from_robot(world),
            seen_left_rad(world),
            self._episode_lesson[index],
        )
