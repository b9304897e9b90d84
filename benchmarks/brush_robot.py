"""A simulator of circuits, cogs and rubber, written to try the identification."""

from dataclasses import dataclass

import numpy as np
from unseen_robot import Body, Drive, Pair, Plane, UnseenRobot, duty_of, torque_about, towards_zero

from mbot_protocol.drive.actions import WheelMaps
from mbot_workstation.measure.tracks.track import Array


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
        driven_s = [one.seconds * sum(map(abs, duty_of(one, maps))) for one in drives]
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
        return force, torque_about(points, traction) + torque_about(ball, drag)

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
        state.current = towards_zero(current, self.step_s * np.array(self.contact_v) / slower)

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
        twist = towards_zero(state.wind, self.play / 2)
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
        state.rotor = towards_zero(free, dry / inertia * self.step_s)
        rolling = self.rolling * loads * radius * state.wheel / np.hypot(state.wheel, 0.2)
        net = passed - traction * radius - rolling
        state.wheel = state.wheel + net / self.wheel_inertia * self.step_s
        state.wind = state.wind + (state.rotor - state.wheel) * self.step_s
