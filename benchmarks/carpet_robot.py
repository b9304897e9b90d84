"""A simulator of speed servos on a pile that gives way, written to try the identification."""

from dataclasses import dataclass

import numpy as np
from unseen_robot import (
    GRAVITY,
    Body,
    Drive,
    Pair,
    Plane,
    UnseenRobot,
    duty_of,
    torque_about,
    towards_zero,
)

from mbot_protocol.drive.actions import WheelMaps
from mbot_workstation.measure.tracks.track import Array


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
            driven = np.array(duty_of(before, maps)) != 0
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
        return force, torque_about(points, traction) + torque_about(where, drag)

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
        load = np.where(driven, load, towards_zero(load, self.hold))
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
