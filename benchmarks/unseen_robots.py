"""Six robots from two simulators of their own: truth that the identification was not tuned on.

`BrushRobot` is built from circuits, cogs and rubber, `CarpetRobot` from speed servos on a pile
that gives way. Plane rigid bodies, semi-implicit Euler, all runs of a session at once. Vectors in
the plane are complex numbers: x ahead, y left. All parameters were chosen before any of these
robots was identified: from public data where there are some ("shops" are sellers' data of 1:48 gear
motors), from what textbooks give as usual ("handbook"), and the rest as estimates ("assumed").
"""

import sys
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # for the tracker in tests/

from mbot_protocol.actions import WheelMaps, to_steps
from mbot_workstation.recordings.maneuver import MANEUVERS
from mbot_workstation.recordings.run import CommandSeries, Recording, Run
from mbot_workstation.recordings.track import Array
from mbot_workstation.simulation.motor import duties
from tests.workstation.planar_robot import Session, Tracker, put_down

Plane = Any  # an array of complex numbers; numpy's types lose their width on the way
Pair = tuple[float, float]  # left and right
Rates = dict[str, tuple[float, float, float | None, float]]

GRAVITY = 9.81
TOLD_S = 0.0005
"""Between poses that are handed out; a robot's own step divides it."""
CALM_S = 4.0
"""A manoeuvre of the truth; its second half is steady."""
SLOWEST_M_S = 0.05
HEADINGS = 8


@dataclass(frozen=True)
class Drive:
    """One run as it was told: manoeuvre, repetition, start and length [s], both actions."""

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
        """Truth of each manoeuvre with a fresh battery and cold motors, over all headings.

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
        return {m.name: _steady(one) for m, one in zip(MANEUVERS, calm, strict=True)}

    def record(self, seed: int, repetitions: int = 6) -> Recording:
        """Drive a session in shuffled order and watch it."""
        session, tracker = Session(repetitions=repetitions), Tracker()
        rng = np.random.default_rng(seed)
        drives = _plan(session, rng)
        longest = max(one.seconds for one in drives) + 2 * session.stand_s
        grid = np.arange(round(longest / TOLD_S), dtype=np.float64) * TOLD_S - session.stand_s
        told = np.array([_duty(one, session.maps) for one in drives])
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
        return Recording("unseen", session.maps, tuple(runs), tracker.ahead_s)

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


def _duty(one: Drive, maps: WheelMaps) -> tuple[float, float]:
    return duties(maps.to_board(to_steps(one.left, one.right)))


def _steady(speeds: Array) -> tuple[float, float, float | None, float]:
    speed, turn = (float(mean) for mean in speeds[len(speeds) // 2 :].mean(axis=0))
    times_s = [
        (int(np.argmax(column / (mean or 1) >= 1 - np.exp(-1))) + 0.5) * TOLD_S
        for column, mean in zip(speeds.T, (speed, turn), strict=True)
    ]
    return speed, turn, times_s[0] if abs(speed) > SLOWEST_M_S else None, times_s[1]


def _torque(points: Plane, force: Plane) -> Array:
    return (np.conj(points) * force).imag.sum(axis=1)


def _towards_zero(value: Array, by: Array | float) -> Array:
    return np.sign(value) * np.maximum(np.abs(value) - by, 0)


@dataclass
class _BrushState:
    charge: Array  # taken from the battery [A s]
    current: Array  # of both motors [A]
    rotor: Array  # seen behind the gear [rad/s]
    wheel: Array  # [rad/s]
    wind: Array  # gear ahead of the wheel, its play included [rad]
    bend: Plane  # of the tread in the contact [m]
    felt: Plane  # acceleration the suspension has followed [m/s2]


@dataclass(frozen=True)
class BrushRobot(UnseenRobot):
    """Small DC motors on one lithium cell, plastic gears with play, tyres with a slip peak.

    A tyre's force over slip is sin(shape atan(slope slip)), as in Pacejka's handbook.
    """

    constant: Pair = (0.00514, 0.00508)  # [V s/rad]; 120 rpm at 3.7 V (paper)
    resistance: Pair = (6.0, 6.2)  # winding, driver [ohm]; 0.6 A stalled (shops), 3.7 V
    contact_v: Pair = (0.1, 0.12)  # lost at the brushes; assumed
    inductance: float = 0.002  # [H]; assumed
    rotor: float = 9e-8  # inertia [kg m2]; 6 g within 5.5 mm, assumed
    gear: float = 48.0  # ratio; public
    stick: Pair = (7e-4, 7.5e-4)  # at the motor's shaft [N m]; turns from duty 0.2
    kinetic: Pair = (4e-4, 4.2e-4)  # [N m]; 0.1 A of no-load current (shops)
    viscous: float = 2e-7  # [N m s/rad]; likewise
    stribeck: float = 30.0  # speed of the shaft at which sticking fades [rad/s]; assumed
    mesh_loss: float = 0.2  # share of the torque passed on that its teeth eat; assumed
    play: float = 0.05  # of the gear, at the wheel [rad]; assumed
    gear_stiffness: float = 2.0  # at the wheel [N m/rad]; assumed
    gear_damping: float = 0.004  # [N m s/rad]; assumed, a third of critical
    wheel_inertia: float = 1.85e-5  # [kg m2]; a disc of 35 g
    cell_ohm: float = 0.15  # with its plug; assumed
    capacity: float = 6480.0  # [A s]; public, 1.8 Ah
    board_a: float = 0.45  # what the boards draw; assumed
    drawn_a: float = 0.15  # of a driven motor, only to reckon what earlier runs took
    grip: float = 0.85  # largest force over load; handbook, rubber on vinyl
    slope: float = 8.0  # assumed, hard rubber
    shape: float = 1.5  # likewise
    relaxation: float = 0.005  # way on which a tread bends [m]; half a contact, assumed
    tread_damping: float = 2.0  # [N s/m]; assumed, a tenth of critical
    rolling: float = 0.012  # resistance over load; handbook, rubber on vinyl
    along: float = 0.12  # friction of the caster's ball over its load, ahead; assumed
    across: float = 0.16  # and sideways, where dirt gathers; assumed
    pitching_s: float = 0.015  # in which loads follow acceleration; assumed
    step_s: float = 0.00025

    def begin(self, start: Array, past: Array) -> _BrushState:
        still = np.zeros((len(start), 2))
        tread = np.zeros((len(start), 2), complex)
        return _BrushState(past[:, 0], still, still, still, still, tread, tread[:, 0])

    def past(self, drives: list[Drive], maps: WheelMaps) -> Array:
        starts_s = np.array([one.start_s for one in drives])
        driven_s = [one.seconds * sum(map(abs, _duty(one, maps))) for one in drives]
        motors = self.drawn_a * (np.cumsum(driven_s) - driven_s)
        return np.tile((self.board_a * (starts_s - starts_s[0]) + motors)[:, None], 2)

    def advance(
        self, state: _BrushState, body: Body, duty: Array, strength: Array
    ) -> tuple[Plane, Array]:
        self._electricity(state, duty, strength)
        points = -self.ahead + 1j * np.array([self.track, -self.track]) / 2
        loads, load = self.loads(state.felt)
        traction = self._tyres(state, body.speed(points), loads)
        self._gears(state, traction.real, loads)
        ball = np.array([self.caster - self.ahead], complex)
        sliding = body.speed(ball)
        resisting = self.along * sliding.real + 1j * self.across * sliding.imag
        drag = -load[:, None] * resisting / np.hypot(np.abs(sliding), 0.003)
        force = traction.sum(axis=1) + drag[:, 0]
        state.felt = state.felt + (force / self.mass - state.felt) * self.step_s / self.pitching_s
        return force, _torque(points, traction) + _torque(ball, drag)

    def _electricity(self, state: _BrushState, duty: Array, strength: Array) -> None:
        share, resistance = state.charge / self.capacity, np.array(self.resistance)
        # A lithium cell's usual shape: steep at first, then almost level.
        open_v = 3.65 + 0.35 * (1 - share) + 0.15 * np.exp(-share / 0.08)
        drawn = self.board_a + np.maximum(duty * state.current, 0).sum(axis=1)
        state.charge = state.charge + self.ageing * drawn * self.step_s
        supply_v = (open_v - self.cell_ohm * drawn)[:, None] * strength
        push_v = duty * supply_v - np.array(self.constant) * self.gear * state.rotor
        slower = self.inductance + self.step_s * resistance
        current = (self.inductance * state.current + self.step_s * push_v) / slower
        state.current = _towards_zero(current, self.step_s * np.array(self.contact_v) / slower)

    def _tyres(self, state: _BrushState, moving: Plane, loads: Array) -> Plane:
        rim = state.wheel * np.array(self.radius)
        bend = state.bend + self.step_s * (rim - moving)
        bend = bend / (1 + self.step_s * np.abs(rim) / self.relaxation)
        bend = bend / np.maximum(np.abs(bend) / self.relaxation, 1)
        rate, state.bend = (bend - state.bend) / self.step_s, bend
        slip = np.maximum(np.abs(bend) / self.relaxation, 1e-9)
        rising = np.sin(self.shape * np.arctan(self.slope * slip)) / slip / self.relaxation
        return self.grip * loads * rising * bend + self.tread_damping * rate

    def _gears(self, state: _BrushState, traction: Array, loads: Array) -> None:
        twist = _towards_zero(state.wind, self.play / 2)
        lag = np.where(twist == 0, 0, self.gear_damping * (state.rotor - state.wheel))
        passed = self.gear_stiffness * twist + lag
        inertia, radius = self.rotor * self.gear**2, np.array(self.radius)
        turning = np.array(self.constant) * self.gear * state.current
        turning = turning - self.viscous * self.gear**2 * state.rotor
        kinetic = np.array(self.kinetic)
        sticking = np.exp(-((self.gear * state.rotor / self.stribeck) ** 2))
        dry = self.gear * (kinetic + (np.array(self.stick) - kinetic) * sticking)
        free = state.rotor + (turning - passed) / inertia * self.step_s
        dry = dry + self.mesh_loss * np.abs(passed)
        state.rotor = _towards_zero(free, dry / inertia * self.step_s)
        rolling = self.rolling * loads * radius * state.wheel / np.hypot(state.wheel, 0.2)
        net = passed - traction * radius - rolling
        state.wheel = state.wheel + net / self.wheel_inertia * self.step_s
        state.wind = state.wind + (state.rotor - state.wheel) * self.step_s


@dataclass
class _CarpetState:
    heat: Array  # share of its strength that each motor has lost
    rim: Array  # speed of both wheels' rims [m/s]
    pile: Plane  # how far the pile leans under each wheel [m]
    swivel: Array  # of the caster against straight ahead [rad]


@dataclass(frozen=True)
class CarpetRobot(UnseenRobot):
    """Speed servos on a short-piled carpet that is not quite level, behind a swivel caster."""

    ahead: float = 0.015
    radius: Pair = (0.0326, 0.0324)
    top: Pair = (12.7, 12.5)  # free speed [rad/s]; 120 rpm (paper) +-10 %
    backward: Pair = (0.99, 0.98)  # share of it, turning backward; assumed
    lag: Pair = (0.04, 0.043)  # of a wheel without load [s]; assumed
    sag: float = 0.05  # rim speed lost to a load [m/s/N]; with `bend` 3.2 N stall it
    bend: float = 0.025  # and to its square [m/s/N2]; assumed
    hold: float = 0.6  # load below which a motor at duty 0 stands [N]; assumed
    fading: Pair = (0.03, 0.03)  # share of strength lost when hot; assumed
    warming: float = 30.0  # time constant while driven [s]; assumed
    cooling: float = 60.0  # and while standing [s]; assumed
    stiffness: float = 3000.0  # of the pile under a wheel [N/m]; assumed
    damping: float = 5.0  # [N s/m]; assumed
    sticking: float = 0.9  # friction over load; assumed, rubber on carpet
    sliding: float = 0.7  # likewise
    stribeck: float = 0.05  # slip at which the first fades into the second [m/s]; assumed
    leaving: float = 100.0  # share of its lean left behind on a metre [1/m]; assumed
    rolling: float = 0.03  # resistance over load; handbook, short carpet
    nap: float = 0.3  # share of it that depends on the pile's direction; assumed
    windage: float = 0.4  # resistance that grows with speed squared [N s2/m2]; assumed
    pile: float = 0.6  # its direction in the room [rad]; any will do
    incline: float = 0.0052  # of the floor [rad]; 0.3 degrees, assumed
    downhill: float = 2.0  # direction in the room [rad]; any will do
    splay: float = 0.0004  # how far each wheel leans outward under load [m/N]; assumed
    trail: float = 0.012  # of the caster's wheel behind its pivot [m]; assumed
    ease: float = 0.25  # share of a free caster's rate at which it swivels; assumed, dry bearing
    scrub: float = 0.2  # friction of its wheel over load, sideways; assumed, nylon
    caster_rolling: float = 0.04  # and rolling; assumed

    def begin(self, start: Array, past: Array) -> _CarpetState:
        still = np.zeros((len(start), 2))
        return _CarpetState(past.copy(), still, still.astype(complex), start[:, 3].copy())

    def past(self, drives: list[Drive], maps: WheelMaps) -> Array:
        heat, result = np.zeros(2), np.zeros((len(drives), 2))
        for k in range(1, len(drives)):
            before, fading = drives[k - 1], np.array(self.fading)
            driven = np.array(_duty(before, maps)) != 0
            stands_s = drives[k].start_s - before.start_s - before.seconds
            hot = fading + (heat - fading) * np.exp(-before.seconds / self.warming)
            cool = heat * np.exp(-before.seconds / self.cooling)
            heat = np.where(driven, hot, cool) * np.exp(-stands_s / self.cooling)
            result[k] = heat
        return result

    def advance(
        self, state: _CarpetState, body: Body, duty: Array, strength: Array
    ) -> tuple[Plane, Array]:
        sideways = body.spin * (body.velocity * np.exp(-1j * body.heading)).real
        loads, load = self.loads(1j * sideways)
        arms = (self.track / 2 + self.splay * loads) * np.array([1, -1])
        points = -self.ahead + 1j * arms
        traction = self._pile(state, body.speed(points), loads)
        self._motors(state, duty, strength, traction.real, self._resistance(state, body, loads))
        drag, where = self._swivel(state, body, load)
        slope = self.mass * GRAVITY * self.incline * np.exp(1j * (self.downhill - body.heading))
        force = traction.sum(axis=1) + drag[:, 0] + slope
        return force, _torque(points, traction) + _torque(where, drag)

    def _pile(self, state: _CarpetState, moving: Plane, loads: Array) -> Plane:
        slipping = state.rim - moving
        pace = np.abs(slipping)
        more = (self.sticking - self.sliding) * np.exp(-((pace / self.stribeck) ** 2))
        limit = loads * (self.sliding + more)
        fading = self.stiffness * pace / limit + self.leaving * np.abs(state.rim)
        lean = (state.pile + self.step_s * slipping) / (1 + self.step_s * fading)
        rate, state.pile = (lean - state.pile) / self.step_s, lean
        return self.stiffness * lean + self.damping * rate

    def _resistance(self, state: _CarpetState, body: Body, loads: Array) -> Array:
        travel = state.rim / np.hypot(state.rim, 0.01)
        combed = 1 - self.nap * np.cos(body.heading - self.pile)[:, None] * travel
        return self.rolling * loads * combed * travel + self.windage * state.rim * abs(state.rim)

    def _motors(
        self, state: _CarpetState, duty: Array, strength: Array, traction: Array, resisting: Array
    ) -> None:
        driven = duty != 0
        aim = np.where(driven, self.fading, 0.0) - state.heat
        pace = np.where(driven, self.warming, self.cooling)
        state.heat = state.heat + self.ageing * aim / pace * self.step_s
        works = duty * (1.3 - 0.3 * np.abs(duty))  # quick at first: assumed
        works = works * np.where(duty < 0, self.backward, 1.0)
        wanted = works * np.array(self.top) * np.array(self.radius) * strength * (1 - state.heat)
        load = traction + resisting
        load = np.where(driven, load, _towards_zero(load, self.hold))
        lost = load * (self.sag + self.bend * np.abs(load))
        state.rim = state.rim + (wanted - lost - state.rim) / np.array(self.lag) * self.step_s

    def _swivel(self, state: _CarpetState, body: Body, load: Array) -> tuple[Plane, Plane]:
        pivot = np.array([self.caster - self.ahead], complex)
        facing = np.exp(1j * state.swivel)[:, None]
        rolling = body.speed(pivot) / facing
        turning = rolling.imag / self.trail - body.spin[:, None]
        state.swivel = state.swivel + self.ease * turning[:, 0] * self.step_s
        scrubbed = (1 - self.ease) * self.trail * turning
        aside = self.scrub * scrubbed / np.hypot(scrubbed, 0.01)
        along = self.caster_rolling * rolling.real / np.hypot(rolling.real, 0.01)
        return -load[:, None] * (along + 1j * aside) * facing, pivot - self.trail * facing


UNSEEN: dict[str, UnseenRobot] = {
    "brush": BrushRobot(),
    "brush, worn left motor": BrushRobot(contact_v=(0.8, 0.12), resistance=(8.5, 6.2)),
    "brush, slippery and heavy": BrushRobot(mass=1.25, inertia=0.003, ahead=0.02, grip=0.3),
    "carpet": CarpetRobot(),
    "carpet, weak right motor": CarpetRobot(top=(12.7, 8.2)),
    "carpet, old": CarpetRobot(
        mass=1.12,
        inertia=0.0027,
        radius=(0.0328, 0.0322),
        top=(11.7, 11.9),
        lag=(0.06, 0.066),
        fading=(0.05, 0.04),
        rolling=0.045,
        scrub=0.25,
    ),
}
"""Of each simulator one healthy robot, one with a motor at about two thirds, one on bad ground or
past its best."""
