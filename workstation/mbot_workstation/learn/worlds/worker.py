"""A process that runs a share of the robots.

It imports neither torch nor stable-baselines3: who wants them in here is a pilot.
"""

import signal
import traceback
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any, assert_never

import cv2
import numpy as np
from numpy.typing import NDArray

from mbot_protocol.errors import MbotError
from mbot_workstation.learn.worlds.robot_eye import RobotEye
from mbot_workstation.learn.worlds.segment import Pilot, SegmentPlan, SegmentShare
from mbot_workstation.learn.worlds.shared_arrays import SharedArrays, SharedMemory
from mbot_workstation.learn.worlds.world import Outcome, World
from mbot_workstation.learn.worlds.world_settings import WorldSettings
from mbot_workstation.sim.effects.body_record import BODY_RECORD
from mbot_workstation.tasks.find import find_task, mistake_in
from mbot_workstation.tasks.lesson import Lesson

PICTURES_A_LOOK = 8


@dataclass(frozen=True, slots=True)
class StepAll:
    """Carry out the actions in shared memory."""


@dataclass(frozen=True, slots=True)
class SetPilot:
    """Have a pilot from now on.

    Attributes:
        pilot: who; in place of the one before.

    """

    pilot: Pilot


@dataclass(frozen=True, slots=True)
class DriveSegment:
    """Let the pilot drive; the reply tells a SegmentShare.

    Attributes:
        decisions: how many, SEGMENT at most.
        slot: of the shared memory, for pictures.
        plan: what the pilot is told.

    """

    decisions: int
    slot: int
    plan: SegmentPlan


@dataclass(frozen=True, slots=True)
class Survey:
    """Take pictures from anywhere; the reply tells what they show. Nothing is driven after it
    until `Reset`.

    Attributes:
        rounds: of one picture each, SEGMENT at most.
        slot: of the shared memory, for pictures.

    """

    rounds: int
    slot: int


@dataclass(frozen=True, slots=True)
class Reset:
    """Start new episodes.

    Attributes:
        seeds: for each of the worker's robots; None goes on with the random numbers it has.

    """

    seeds: tuple[int | None, ...]


@dataclass(frozen=True, slots=True)
class SetLesson:
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


Order = StepAll | SetPilot | DriveSegment | Survey | Reset | SetLesson
Request = Order | Quit


@dataclass(frozen=True, slots=True)
class Done:
    """The request has been carried out.

    Attributes:
        segment: that it has driven, if that was the request.
        shown: the task's facts of what it has taken pictures of, shape (rounds, n), likewise.

    """

    segment: SegmentShare | None = None
    shown: "NDArray[np.void] | None" = None


@dataclass(frozen=True, slots=True)
class Failed:
    """It has not, and the worker has ended.

    Attributes:
        error: what a person can mend, or the traceback of what nobody has thought of.

    """

    error: MbotError | str


Reply = Done | Failed


def run_worker(pipe: Connection, memory: SharedMemory, robots: range) -> None:
    """Serve requests until told to quit or left alone.

    Args:
        pipe: the task's reference in, WorldSettings, then requests; a reply to each of these and
            one when the worlds are built.
        memory: shared.
        robots: which rows of the memory are this worker's.

    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # also if a thread has started it
    cv2.setNumThreads(1)  # small pictures: handing them to threads costs more than the work
    reference = ""
    try:
        reference = pipe.recv()
        find_task(reference)  # first: the settings may hold classes of a user's file
        settings: WorldSettings = pipe.recv()
        with RobotEye(settings.rooms, settings.robot, settings.scene, settings.floors) as eye:
            share = _Share(eye, memory.arrays(), robots, settings)
            pipe.send(Done())
            while not isinstance(request := pipe.recv(), Quit):
                pipe.send(share.carry_out(request))
    except (EOFError, BrokenPipeError):
        return  # the environment has gone
    except MbotError as error:
        pipe.send(Failed(error))
    except Exception as error:  # a mistake of the task's author, or of ours; the other side raises
        pipe.send(Failed(mistake_in(reference, error) or traceback.format_exc()))


class _Share:
    """The robots of one worker."""

    def __init__(
        self, eye: RobotEye, arrays: SharedArrays, robots: range, settings: WorldSettings
    ) -> None:
        self._eye, self._arrays, self._robots = eye, arrays, robots
        self._rows = slice(robots.start, robots.stop)
        self._worlds = [World(settings) for _ in robots]
        self._pilot: Pilot | None = None
        self._lesson, self._lesson_number = settings.lesson, 0
        self._episode_lesson = [0] * len(robots)

    def carry_out(self, request: Order) -> Done:
        """Do what is asked, and say what there is to be told of it."""
        match request:
            case StepAll():
                self._step_all()
            case SetPilot(pilot):
                self._pilot = pilot
            case DriveSegment(decisions, slot, plan):
                return Done(self._drive(decisions, slot, plan))
            case Survey(rounds, slot):
                return Done(shown=self._survey(rounds, slot))
            case Reset(seeds):
                for index, seed in enumerate(seeds):
                    if seed is not None:
                        self._worlds[index].seed(np.random.default_rng(seed))
                    self._begin(index)
                self._observe()
            case SetLesson(lesson, number):
                self._lesson, self._lesson_number = lesson, number
            case _:
                assert_never(request)
        return Done()

    def _drive(self, decisions: int, slot: int, plan: SegmentPlan) -> SegmentShare:
        """All by itself: whoever waits for all robots at every decision waits for the slowest."""
        pilot, arrays, rows = self._pilot, self._arrays, self._rows
        if pilot is None:
            raise RuntimeError("there is no pilot to drive: SetPilot first")
        pictures, records = arrays.frames[rows], arrays.records[rows]
        seen = arrays.segments[slot, :, rows]
        shape = (decisions, len(self._robots))
        situations, outcomes = (np.empty(shape, arrays.records.dtype) for _ in range(2))
        bodies = np.empty(shape, BODY_RECORD)
        pilot.start(plan)
        for now in range(decisions):
            seen[now], situations[now], bodies[now] = (
                pictures,
                arrays.now[rows],
                arrays.bodies[rows],
            )
            arrays.actions[rows] = pilot.decide(pictures)
            self._step_all()
            outcomes[now] = records
            pilot.arrive(outcomes[now]["ended"])
        return SegmentShare(situations, bodies, outcomes, pilot.decisions())

    def _survey(self, rounds: int, slot: int) -> NDArray[np.void]:
        """Robots, rooms and looks are others every eighth time: drawing these costs as much."""
        shown = np.empty((rounds, len(self._robots)), self._arrays.records.dtype)
        for now in range(rounds):
            for index, world in enumerate(self._worlds):
                if now % PICTURES_A_LOOK == 0:
                    self._begin(index)
                world.scatter()
                shown[now, index] = self._record(index, Outcome())
            pictures = self._eye.observe_all(self._worlds)
            self._arrays.segments[slot, now, self._rows] = pictures
        return shown

    def _step_all(self) -> None:
        # All physics first, then all pictures: a processor's cache holds one of the two.
        for index in range(len(self._worlds)):
            self._step(index)
        self._observe()

    def _observe(self) -> None:
        for row, picture in zip(self._robots, self._eye.observe_all(self._worlds), strict=True):
            self._arrays.frames[row] = picture

    def _step(self, index: int) -> None:
        world, row = self._worlds[index], self._robots[index]
        left, right = self._arrays.actions[row].tolist()
        outcome = world.decide(left, right)
        self._arrays.records[row] = self._arrays.now[row] = self._record(index, outcome)
        self._arrays.bodies[row] = world.body
        if outcome.ended:
            self._arrays.last_frames[row] = self._eye.observe(world)
            self._begin(index)

    def _begin(self, index: int) -> None:
        self._worlds[index].begin(self._lesson)
        self._episode_lesson[index] = self._lesson_number
        row = self._robots[index]
        self._arrays.now[row] = self._record(index, Outcome())
        self._arrays.bodies[row] = self._worlds[index].body

    def _record(self, index: int, outcome: Outcome) -> tuple[Any, ...]:
        world = self._worlds[index]
        happening = world.task.happenings.index(outcome.happening)
        lesson = self._episode_lesson[index]
        return (outcome.reward, outcome.ended, happening, lesson, *world.facts())
