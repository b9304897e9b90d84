"""A robot and its session for simulators of their own: what `BrushRobot` and `CarpetRobot` share.

Plane rigid bodies, semi-implicit Euler, all runs of a session at once. Vectors in the plane are
complex numbers: x ahead, y left. All parameters were chosen before any of these robots was
identified: from public data where there are some ("shops" are sellers' data of 1:48 gear motors),
from what is usual in textbooks as remembered ("handbook"), and the rest as estimates ("assumed").
"""

import sys
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # for the tracker in tests/

from steady_rates import Rates, steady_rates

from mbot_protocol.drive.actions import WheelMaps, to_steps
from mbot_workstation.measure.tracks.maneuver import MANEUVERS
from mbot_workstation.measure.tracks.run import CommandSeries, ManeuverRecording, Run
from mbot_workstation.measure.tracks.track import Array
from mbot_workstation.sim.body.motor import pwm_duties
from tests.workstation.planar_robot import Session, Tracker, put_down

Plane = Any  # an array of complex numbers; numpy's types lose their width on the way
Pair = tuple[float, float]  # left and right

GRAVITY = 9.81
TOLD_S = 0.0005
"""Between poses that are handed out; a robot's own step divides it."""
CALM_S = 4.0
"""A maneuver of the truth; its second half is steady."""
HEADINGS = 8


@dataclass(frozen=True)
class Drive:
    """One run as it was told: maneuver, repetition, start and length [s], both actions."""

    name: str
    repetition: int
    start_s: float
    seconds: float
    left: float
    right: float


@dataclass
class Body:
    """A rigid body in the plane, of every run: centre of mass [m], heading [rad], velocities."""

    place: Plane
    heading: Array
    velocity: Plane
    spin: Array

    @classmethod
    def standing(cls, start: Array, ahead: float) -> "Body":
        """At rest, the axle's centre at x, y, yaw and the centre of mass ahead of it."""
        centre = start[:, 0] + 1j * start[:, 1] + ahead * np.exp(1j * start[:, 2])
        return cls(centre, start[:, 2].copy(), np.zeros_like(centre), np.zeros(len(start)))

    def speed(self, points: Plane) -> Plane:
        """Velocity [m/s] in the body's own directions at points (k,) or (runs, k) of it."""
        own = self.velocity * np.exp(-1j * self.heading)
        return own[:, None] + 1j * self.spin[:, None] * points

    def push(self, acceleration: Plane, turning: Array, step_s: float) -> None:
        """One step under an acceleration in the body's own directions and a turning one."""
        self.velocity = self.velocity + acceleration * np.exp(1j * self.heading) * step_s
        self.spin = self.spin + turning * step_s
        self.place = self.place + self.velocity * step_s
        self.heading = self.heading + self.spin * step_s


@dataclass(frozen=True)
class UnseenRobot(ABC):
    """What both simulators have in common."""

    mass: float = 1.0  # [kg]; parts list, tracker included
    inertia: float = 0.0023  # about the centre of mass [kg m2]; parts list
    ahead: float = 0.013  # of the centre of mass, from the axle [m]; parts list
    height: float = 0.048  # of the centre of mass [m]; parts list
    track: float = 0.115  # between the wheels' middles [m]; public measurement
    radius: Pair = (0.0325, 0.0325)  # of the wheels [m]; public measurement
    caster: float = 0.075  # how far ahead of the axle its ball or pivot is [m]; public drawings
    delay: float = 0.025  # from command to voltage [s]; assumed
    repeat: float = 0.005  # scatter of a motor's strength from run to run, a share; assumed
    wander: float = 0.003  # further scatter from second to second, a share; assumed
    ageing: float = 1.0  # 0 for a battery that stays charged and motors that stay cold
    step_s: float = TOLD_S  # of the integration

    @abstractmethod
    def begin(self, start: Array, past: Array) -> Any:
        """State of motors, tyres and caster at rest. `start` and `past` as in `drive`."""

    @abstractmethod
    def advance(self, state: Any, body: Body, duty: Array, strength: Array) -> tuple[Plane, Array]:
        """One step of `state`; the force [N] and torque [N m] on the body, in its directions."""

    @abstractmethod
    def past(self, drives: list[Drive], maps: WheelMaps) -> Array:
        """What the runs before left behind at each run's start, shape (runs, 2)."""

    def drive(self, duty: Array, strength: Array, start: Array, past: Array) -> tuple[Array, Array]:
        """Integrate from standstill.

        Args:
            duty: forward-positive duty of both motors every TOLD_S, shape (runs, times, 2).
            strength: factor on each motor's drive, same shape.
            start: x [m], y [m], yaw [rad] of the axle's centre and the angle [rad] at which the
                caster was left, shape (runs, 4).
            past: see there; zeros for a charged battery and cold motors.

        Returns:
            Pose (x, y, yaw) at the end of each time, shape (runs, times, 3), and the axle's
            forward speed and the turn rate, shape (runs, times, 2).

        """
        runs, times, _ = duty.shape
        body, state = Body.standing(start, self.ahead), self.begin(start, past)
        poses, speeds = np.empty((runs, times, 3)), np.empty((runs, times, 2))
        for k in range(times):
            for _ in range(round(TOLD_S / self.step_s)):
                force, torque = self.advance(state, body, duty[:, k], strength[:, k])
                body.push(force / self.mass, torque / self.inertia, self.step_s)
            facing = np.exp(1j * body.heading)
            axle = body.place - self.ahead * facing
            poses[:, k] = np.stack([axle.real, axle.imag, body.heading], 1)
            speeds[:, k] = np.stack([(body.velocity / facing).real, body.spin], 1)
        return poses, speeds

    def loads(self, felt: Plane) -> tuple[Array, Array]:
        """What presses on both wheels (runs, 2) and the caster (runs,) [N] at an acceleration."""
        weight = self.mass * GRAVITY
        tilting = self.mass * (GRAVITY * self.ahead - self.height * felt.real)
        caster = np.clip(tilting / self.caster, 0, 0.8 * weight)
        outward = self.mass * self.height * felt.imag / self.track
        wheels = (weight - caster)[:, None] / 2 + outward[:, None] * np.array([-1, 1])
        return np.maximum(wheels, 0.05 * weight), caster

    def rates(self) -> Rates:
        """Truth of each maneuver with a fresh battery and cold motors, over all headings.

        Returns:
            Forward speed [m/s], turn rate [rad/s] (positive turns left) and the times [s] in which
            both come to 63 % of that; None where the robot hardly moves ahead.

        """
        start = np.zeros((HEADINGS * 2, 4))
        start[:, 2] = np.repeat(np.arange(HEADINGS) * 2 * np.pi / HEADINGS, 2)
        start[:, 3] = np.tile([0.3, -0.3], HEADINGS)
        actions = np.repeat([[m.left, m.right] for m in MANEUVERS], len(start), axis=0)
        duty = np.repeat(actions[:, None], round(CALM_S / TOLD_S), axis=1)
        starts = np.tile(start, (len(MANEUVERS), 1))
        fresh, past = replace(self, ageing=0.0), np.zeros((len(starts), 2))
        speeds = fresh.drive(duty, np.ones_like(duty), starts, past)[1]
        calm = speeds.reshape(len(MANEUVERS), len(start), -1, 2).mean(axis=1)
        return {
            m.name: steady_rates(one[:, 0], one[:, 1], TOLD_S)
            for m, one in zip(MANEUVERS, calm, strict=True)
        }

    def record(self, seed: int, repetitions: int = 6) -> ManeuverRecording:
        """Drive a session in shuffled order and watch it."""
        session, tracker = Session(repetitions=repetitions), Tracker()
        rng = np.random.default_rng(seed)
        drives = _plan(session, rng)
        longest = max(one.seconds for one in drives) + 2 * session.stand_s
        grid = np.arange(round(longest / TOLD_S), dtype=np.float64) * TOLD_S - session.stand_s
        told = np.array([duty_of(one, session.maps) for one in drives])
        ends = np.array([one.seconds for one in drives])[:, None]
        works = (grid >= self.delay) & (grid < ends + self.delay)
        strength = self._strength(len(drives), grid.size, rng)
        spots = [put_down(np.zeros((1, 3)), rng)[0] for _ in drives]
        start = np.column_stack([spots, rng.normal(0, 0.2, len(drives))])  # by hand: assumed
        past = self.past(drives, session.maps)
        poses, _ = self.drive(told[:, None] * works[..., None], strength, start, past)
        runs: list[Run] = []
        for one, path in zip(drives, poses, strict=True):
            edges = one.start_s + np.array([0.0, one.seconds])
            commands = CommandSeries(edges, np.array([one.left, 0.0]), np.array([one.right, 0.0]))
            last = grid <= one.seconds + session.stand_s
            track = tracker.watch(one.start_s + TOLD_S + grid[last], path[last], rng)
            runs.append(Run(len(runs) + 1, one.name, one.repetition, commands, track))
        return ManeuverRecording("unseen", session.maps, tuple(runs), tracker.ahead_s)

    def _strength(self, runs: int, times: int, rng: np.random.Generator) -> Array:
        seconds = np.arange(times) * TOLD_S
        knots = np.arange(0, seconds[-1] + 2)
        bumps = rng.normal(0, self.wander, (runs, 2, knots.size))
        smooth = np.array([[np.interp(seconds, knots, one) for one in pair] for pair in bumps])
        return (1 + rng.normal(0, self.repeat, (runs, 2, 1)) + smooth).transpose(0, 2, 1)


def _plan(session: Session, rng: np.random.Generator) -> list[Drive]:
    names = [name for name in session.schedules for _ in range(session.repetitions)]
    drives: list[Drive] = []
    clock_s = 100.0
    for name in rng.permutation(names):
        ((seconds, left, right),) = session.schedules[str(name)]
        seconds += rng.uniform(-0.01, 0.01)
        earlier = sum(one.name == name for one in drives)
        drives.append(Drive(str(name), earlier + 1, clock_s, seconds, left, right))
        clock_s += seconds + session.pause_s + rng.uniform(0, 2)
    return drives


def duty_of(one: Drive, maps: WheelMaps) -> tuple[float, float]:
    """Forward-positive duty of both motors while the run lasts."""
    return pwm_duties(maps.duties(to_steps(one.left, one.right)))


def torque_about(points: Plane, force: Plane) -> Array:
    """Sum of the torques [N m] of forces (runs, k) at points (k,) or (runs, k), shape (runs,)."""
    return (np.conj(points) * force).imag.sum(axis=1)


def towards_zero(value: Array, by: Array | float) -> Array:
    """Less by so much, but never beyond zero: what dry friction does in a step."""
    return np.sign(value) * np.maximum(np.abs(value) - by, 0)
