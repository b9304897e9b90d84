"""The simulation in real time: the board's motors drive it, the task watches it."""

import queue
import threading
import time
from collections import deque
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from mbot_protocol.drive.mcore import Joystick
from mbot_workstation.pacer import Pacer
from mbot_workstation.sim.body.motor import pwm_duties
from mbot_workstation.sim.pose import ORIGIN, Pose
from mbot_workstation.sim.simulation import Simulation
from mbot_workstation.tasks.fetch.rules import FetchRules
from mbot_workstation.tasks.fetch.run import FetchResult, FetchTask, Happening
from mbot_workstation.virtual.carry_back import CarryBack
from mbot_workstation.virtual.mcore_board import BoardState
from mbot_workstation.virtual.scene_history import SceneHistory

SLICE_S = 0.005
"""One physics step: a command waits no longer for its effect."""

MOST_SLICES_AT_ONCE = 20
"""0.1 s; after a longer stall of this machine the simulated world simply stood still."""

MOST_SLICES_IN_A_MANEUVER = 400
"""2 s, made up within 10 ms: motors that hold their speed turn on while this machine stalls, and a
world that stood still would show as a robot that is slower than it is."""


@dataclass(frozen=True, slots=True)
class WorldStatus:
    """What is going on.

    Attributes:
        time_s: simulated time.
        robot, target: poses.
        motors: the board's speeds.
        wheel_speeds_rad_s: left and right.
        result: the run so far.
        ended: whether the run is over.

    """

    time_s: float
    robot: Pose
    target: Pose
    motors: Joystick
    wheel_speeds_rad_s: tuple[float, float]
    result: FetchResult
    ended: bool


@dataclass(frozen=True, slots=True)
class TaskEvent:
    """Something the task has counted.

    Attributes:
        time_s: simulated time.
        happening: what.
        score: what it was worth.
        result: the run including it.

    """

    time_s: float
    happening: Happening
    score: float
    result: FetchResult


class MotorSource(Protocol):
    """A board, as far as the wheels are concerned."""

    @property
    def state(self) -> BoardState:
        """What its motors do now; raises MbotError when it can't be told any more."""
        ...


class LiveWorld:
    """Steps simulation and task on the clock.

    The task's time starts when the motors are first told to turn: a robot nobody drives yet has
    not failed.

    Attributes:
        history: the last moments, for the camera.
        events: what the task has counted, until somebody takes it out.

    """

    def __init__(
        self,
        simulation: Simulation,
        board: MotorSource,
        rules: FetchRules,
        seed: int,
        latency_s: float = 0.0,
        *,
        free_floor: bool = False,
    ) -> None:
        """Put the robot at the start.

        Args:
            simulation, board: the robot.
            rules: of the task.
            seed: of the objects' places.
            latency_s: from the board's motors to the wheels' voltage, rounded to slices.
            free_floor: no task; a robot that stands is carried back to the middle.

        """
        self._simulation = simulation
        self._board = board
        self._task = FetchTask(rules, np.random.default_rng(seed))
        self.history = SceneHistory(SLICE_S)
        self.events: queue.SimpleQueue[TaskEvent] = queue.SimpleQueue()
        self._lock = threading.Lock()
        self._driven = False
        self._carry_back = CarryBack() if free_floor else None
        self._told = Joystick(0, 0)
        self._newest, self._newest_since_s = self._told, 0.0
        # What the board said in the last slices; the oldest reaches the wheels.
        self._underway = deque([Joystick(0, 0)] * round(latency_s / SLICE_S))
        simulation.place_object(self._task.target, self._task.kind)
        self.history.add(time.monotonic(), simulation.snapshot())

    def status(self) -> WorldStatus:
        """What is going on now; from any thread."""
        with self._lock:
            return WorldStatus(
                time_s=self._simulation.time_s,
                robot=self._simulation.pose,
                target=self._task.target,
                motors=self._board.state.motors,
                wheel_speeds_rad_s=self._simulation.wheel_speeds_rad_s,
                result=self._task.result(),
                ended=self._task.ended,
            )

    def run(self, stop: threading.Event) -> None:
        """Step until stopped or until the run has ended.

        However late this thread wakes up, every slice has its own moment: it obeys the command of
        that moment, and its state is kept with that time. So a busy machine shows outside as lost
        pictures and poses, not as a robot that starts early and trembles.
        """
        most = MOST_SLICES_AT_ONCE if self._carry_back is None else MOST_SLICES_IN_A_MANEUVER
        pacer = Pacer(SLICE_S, most)
        while (slices := pacer.wait(stop)) > 0:
            with self._lock:
                for late in reversed(range(slices)):
                    moment_s = pacer.tick_s - late * SLICE_S
                    self.advance(moment_s)
                    if self._task.ended:
                        return
                    self.history.add(moment_s, self._simulation.snapshot())

    def advance(self, moment_s: float) -> None:
        """One slice, which ends at this moment of the monotonic clock."""
        simulation = self._simulation
        motors = self._motors_at(moment_s)
        self._underway.append(motors)
        simulation.set_duty(*pwm_duties(self._underway.popleft().duties))
        simulation.step(SLICE_S)
        self._driven = self._driven or not motors.is_stop
        if self._carry_back is not None:
            if self._driven:
                self._task.travel(simulation.pose, SLICE_S)
            if self._carry_back.is_due(
                driven=not motors.is_stop, pose=simulation.pose, elapsed_s=SLICE_S
            ):
                simulation.place_robot(ORIGIN)
                self._task.carried(ORIGIN)
            return
        if not self._driven:
            return
        step = self._task.advance(simulation.pose, SLICE_S)
        if step.happening is Happening.NOTHING:
            return
        if step.robot_to_origin:
            simulation.place_robot(ORIGIN)
        if step.object_moved:
            simulation.place_object(self._task.target, self._task.kind)
        self.events.put(
            TaskEvent(simulation.time_s, step.happening, step.score, self._task.result())
        )

    def _motors_at(self, moment_s: float) -> Joystick:
        """What the board told its motors at a moment, which may be past."""
        state = self._board.state
        if state.motors != self._newest:  # not when the same is only told again
            self._newest, self._newest_since_s = state.motors, state.since_s
        if self._newest_since_s <= moment_s:
            self._told = self._newest
        return self._told
