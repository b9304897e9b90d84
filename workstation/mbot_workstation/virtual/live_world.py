"""The simulation in real time: the board's motors drive it, the task watches it."""

import colorsys
import math
import queue
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from mbot_protocol.drive.mcore import Joystick
from mbot_workstation.pacer import Pacer
from mbot_workstation.sim.body.motor import pwm_duties
from mbot_workstation.sim.pose import ORIGIN, Pose
from mbot_workstation.sim.scene.scene_look import Distractor, SceneLook
from mbot_workstation.sim.scene.target_object import TargetObject
from mbot_workstation.sim.simulation import Simulation
from mbot_workstation.tasks.episode import NOTHING, Setting
from mbot_workstation.tasks.lesson import Lesson
from mbot_workstation.tasks.task import Task
from mbot_workstation.virtual.mcore_board import BoardState
from mbot_workstation.virtual.scene_history import SceneHistory

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
        robot: its pose.
        objects: where those stand that are there.
        colours: of these from afar, RGB, 0-255.
        motors: the board's speeds.
        wheel_speeds_rad_s: left and right.
        result: the run so far, in JSON's types.
        ended: whether the run is over.

    """

    time_s: float
    robot: Pose
    objects: tuple[Pose, ...]
    motors: Joystick
    wheel_speeds_rad_s: tuple[float, float]
    result: Mapping[str, Any]
    ended: bool
    colours: tuple[tuple[int, int, int], ...] = ()


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
    happening: str
    score: float
    result: Mapping[str, Any]


class Odometer:
    """How far the robot has driven, and for how long."""

    def __init__(self) -> None:
        self._robot = ORIGIN
        self._driven_m = self._duration_s = 0.0

    def advance(self, robot: Pose, elapsed_s: float) -> None:
        """Count the way to here."""
        self._driven_m += math.hypot(robot.x_m - self._robot.x_m, robot.y_m - self._robot.y_m)
        self._duration_s += elapsed_s
        self._robot = robot

    def carried(self, robot: Pose) -> None:
        """Somebody has put the robot here, which is no way it drove."""
        self._robot = robot

    def figures(self) -> dict[str, float]:
        """In JSON's types."""
        return {
            "distance_driven_m": round(self._driven_m, 3),
            "duration_s": round(self._duration_s, 3),
        }


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
        task: what the robot is to do.
        history: the last moments, for the camera.
        events: what the task has counted, until somebody takes it out.

    """

    def __init__(
        self,
        simulation: Simulation,
        board: MotorSource,
        task: Task,
        lesson: Lesson,
        setting: Setting,
        seed: int,
        latency_s: float = 0.0,
        *,
        free_floor: bool = False,
        feel: Callable[[Pose, Sequence[tuple[int, Pose]]], None] = lambda *_: None,
    ) -> None:
        """Put the robot at the start.

        Args:
            simulation, board: the robot.
            task, lesson, setting: what it is to do, and where.
            seed: of the objects' places.
            latency_s: from the board's motors to the wheels' voltage, rounded to slices.
            free_floor: nothing is counted; a robot that stands is carried back to the middle.
            feel: hears with each slice where the robot is and where which objects stand.

        """
        self._feel = feel
        self._simulation = simulation
        self._board = board
        self.task = task
        self._episode = task.begin(lesson, setting, np.random.default_rng(seed))
        self._colours = [_colour(thing) for thing in simulation.scene.objects]
        self._odometer = Odometer()
        self.history = SceneHistory(SLICE_S)
        self.events: queue.SimpleQueue[TaskEvent] = queue.SimpleQueue()
        self._lock = threading.Lock()
        self._driven = False
        self._carry_back = CarryBack() if free_floor else None
        self._told = Joystick(0, 0)
        self._newest, self._newest_since_s = self._told, 0.0
        # What the board said in the last slices; the oldest reaches the wheels.
        self._underway = deque([Joystick(0, 0)] * round(latency_s / SLICE_S))
        simulation.place_objects(self._episode.places())
        self.history.add(time.monotonic(), simulation.snapshot())

    def pieces(self) -> tuple[Distractor, ...]:
        """What the task has put into the arena, beside the scene's objects."""
        return self.task.pieces(self._episode)

    def status(self) -> WorldStatus:
        """What is going on now; from any thread."""
        with self._lock:
            places = self._episode.places()
            return WorldStatus(
                time_s=self._simulation.time_s,
                robot=self._simulation.pose,
                objects=tuple(places.values()),
                motors=self._board.state.motors,
                wheel_speeds_rad_s=self._simulation.wheel_speeds_rad_s,
                result=self._result(),
                ended=self._episode.ended,
                colours=tuple(self._colours[kind] for kind in places),
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
                    if self._episode.ended:
                        return
                    self.history.add(moment_s, self._simulation.snapshot())

    def advance(self, moment_s: float) -> None:
        """One slice, which ends at this moment of the monotonic clock."""
        simulation = self._simulation
        motors = self._motors_at(moment_s)
        self._underway.append(motors)
        simulation.set_duty(*pwm_duties(self._underway.popleft().duties))
        simulation.step(SLICE_S)
        self._feel(simulation.pose, tuple(self._episode.places().items()))
        self._driven = self._driven or not motors.is_stop
        if self._driven:
            self._odometer.advance(simulation.pose, SLICE_S)
        if self._carry_back is not None:
            if self._carry_back.is_due(
                driven=not motors.is_stop, pose=simulation.pose, elapsed_s=SLICE_S
            ):
                self._to_origin()
            return
        if not self._driven:
            return
        step = self._episode.advance(simulation.pose, SLICE_S)
        if step.pushed_m != (0.0, 0.0):
            simulation.push(*step.pushed_m)
        if step.happening == NOTHING:
            return
        if step.robot_to_origin:
            self._to_origin()
        if not step.ended:
            simulation.place_objects(self._episode.places())
        self.events.put(TaskEvent(simulation.time_s, step.happening, step.score, self._result()))

    def _to_origin(self) -> None:
        self._simulation.place_robot(ORIGIN)
        self._odometer.carried(ORIGIN)

    def _result(self) -> Mapping[str, Any]:
        return {**self._episode.result(), **self._odometer.figures()}

    def _motors_at(self, moment_s: float) -> Joystick:
        """What the board told its motors at a moment, which may be past."""
        state = self._board.state
        if state.motors != self._newest:  # not when the same is only told again
            self._newest, self._newest_since_s = state.motors, state.since_s
        if self._newest_since_s <= moment_s:
            self._told = self._newest
        return self._told


def setting_of(simulation: Simulation, look: SceneLook) -> Setting:
    """What an episode in this simulation is played with, when it looks like this."""
    scene = simulation.scene
    return Setting(
        contact_radius_m=simulation.robot.touch_radius_m,
        border_m=scene.arena.border_m,
        footprints=tuple(
            thing.footprint.scaled(worn.scale)
            for thing, worn in zip(scene.objects, look.objects, strict=True)
        ),
        standing=look.standing,
    )


def _colour(thing: TargetObject) -> tuple[int, int, int]:
    red, green, blue = colorsys.hsv_to_rgb(*thing.mean_hsv)
    return round(255 * red), round(255 * green), round(255 * blue)
