"""A robot that is not MuJoCo's, and the tracker that watches it: truth for the identification.

Plane rigid body on two tyres, semi-implicit Euler at 2 kHz, all runs of a session at once. Its
motors have a curved dead band and Coulomb friction, its tyres give way under load and slide beyond
their grip; none of that is in the model that is fitted.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from mbot_protocol.drive.actions import WheelMaps, to_steps
from mbot_workstation.measure.tracks.maneuver import MANEUVERS
from mbot_workstation.measure.tracks.run import CommandSeries, ManeuverRecording, Run
from mbot_workstation.measure.tracks.track import Array, Track
from mbot_workstation.sim.body.motor import pwm_duties

STEP_S = 0.0005
GRAVITY = 9.81

Schedule = tuple[tuple[float, float, float], ...]
"""Pieces of a run: seconds, left action, right action."""


@dataclass(frozen=True)
class PlanarRobot:
    """Per-wheel values are (left, right).

    Attributes:
        top_speed: of the free rim at full duty [m/s].
        lag: time constant of a wheel that drives its half of the robot [s].
        threshold: duty below which the motor does not turn.
        bend: exponent of the working duty; 1 would be the fitted model's straight line.
        backward: strength of a motor that turns backward, as a share.
        friction: Coulomb friction, as the rim speed it costs [m/s].
        mass, inertia: [kg], [kg m2].
        track: between the wheels [m].
        grip: friction coefficient of the tyres.
        creep: slip speed per unit of a wheel's tractive acceleration [s]; a stiffness.
        drag: friction of the caster on the floor [N].
        caster: how far ahead of the axle it is [m].
        delay: from command to voltage [s].
        repeat: scatter of each motor's strength from run to run, as a share.
        wander: further scatter from second to second, as a share.

    """

    top_speed: tuple[float, float] = (0.43, 0.41)
    lag: tuple[float, float] = (0.11, 0.12)
    threshold: tuple[float, float] = (0.17, 0.20)
    bend: float = 0.9
    backward: tuple[float, float] = (1.0, 1.0)
    friction: tuple[float, float] = (0.012, 0.015)
    mass: float = 1.02
    inertia: float = 0.0035
    track: float = 0.117
    grip: float = 0.8
    creep: float = 0.006
    drag: float = 0.15
    caster: float = 0.07
    delay: float = 0.03
    repeat: float = 0.003
    wander: float = 0.003

    def drive(self, duty: Array, strength: Array) -> tuple[Array, Array]:
        """Integrate from standstill.

        Args:
            duty: forward-positive duty of both motors, shape (runs, steps, 2).
            strength: factor on each motor's speed, same shape.

        Returns:
            Pose (x, y, yaw) at each step's end, shape (runs, steps, 3), and the body's forward
            speed and turn rate, shape (runs, steps, 2).

        """
        top, lag, floor = np.array(self.top_speed), np.array(self.lag), np.array(self.threshold)
        working = np.clip((np.abs(duty) - floor) / (1 - floor), 0, 1) ** self.bend
        wanted = np.sign(duty) * working * top * strength
        wanted = wanted * np.where(duty < 0, np.array(self.backward), 1.0)
        runs, steps, _ = duty.shape
        rim_mass = 0.1 * self.mass  # of one wheel and rotor
        push = (self.mass / 2 + rim_mass) / lag  # [N s/m]
        stick = push * np.array(self.friction)
        stiffness = self.mass / 2 / self.creep
        limit = self.grip * self.mass * GRAVITY / 2 * 0.85  # the caster carries the rest
        rim, body, pose = np.zeros((runs, 2)), np.zeros((runs, 2)), np.zeros((runs, 3))
        poses, speeds = np.empty((runs, steps, 3)), np.empty((runs, steps, 2))
        arm = np.array([-self.track / 2, self.track / 2])
        for k in range(steps):
            ground = body[:, :1] + body[:, 1:] * arm
            traction = np.clip(stiffness * (rim - ground), -limit, limit)
            force = push * (wanted[:, k] - rim) - traction
            free = rim + force / rim_mass * STEP_S
            brake = stick / rim_mass * STEP_S
            rim = np.sign(free) * np.maximum(np.abs(free) - brake, 0)
            sliding = np.stack([body[:, 0], body[:, 1] * self.caster], 1)
            pace = np.maximum(np.hypot(*sliding.T), 0.005)  # below, like honey
            resisting = self.drag * sliding / pace[:, None]
            body[:, 0] += (traction.sum(1) - resisting[:, 0]) / self.mass * STEP_S
            turning = traction @ arm - resisting[:, 1] * self.caster
            body[:, 1] += turning / self.inertia * STEP_S
            middle = pose[:, 2] + body[:, 1] * STEP_S / 2
            pose[:, 0] += body[:, 0] * np.cos(middle) * STEP_S
            pose[:, 1] += body[:, 0] * np.sin(middle) * STEP_S
            pose[:, 2] += body[:, 1] * STEP_S
            poses[:, k], speeds[:, k] = pose, body
        return poses, speeds

    def steady(self, left: float, right: float, maps: WheelMaps | None = None) -> Array:
        """Forward speed [m/s] and turn rate [rad/s] after four seconds of these actions."""
        duty = np.tile(
            pwm_duties((maps or WheelMaps()).duties(to_steps(left, right))), (1, 8000, 1)
        )
        calm = self.drive(duty, np.ones_like(duty))[1]
        return calm[0, -2000:].mean(axis=0)


@dataclass(frozen=True)
class Tracker:
    """A tracker on the robot, and its room. SI units, angles in degrees where said.

    Attributes:
        ahead, left, up: where it sits, from the axle's centre on the floor.
        mount_deg: yaw, pitch, roll of it on the robot.
        floor_deg: how far its room's z leans away from the floor's normal, about x and y.
        noise, noise_deg: standard deviations.
        rate_hz, jitter: of its poses.
        lost: share of single poses that are missing.
        gaps: how many times a run it is blind, for 0.05 to 0.2 s.
        wrong: share of poses that are far off.
        ahead_s, drift: its clock: offset at the robot's time 0, and its rate beyond 1.

    """

    ahead: float = -0.035
    left: float = 0.012
    up: float = 0.11
    mount_deg: tuple[float, float, float] = (25.0, 3.0, -2.0)
    floor_deg: tuple[float, float] = (1.0, -0.7)
    noise: float = 0.004
    noise_deg: float = 0.3
    rate_hz: float = 90.0
    jitter: float = 0.0015
    lost: float = 0.03
    gaps: float = 0.7
    wrong: float = 0.002
    ahead_s: float = 5.0
    drift: float = 40e-6

    def watch(self, time_s: Array, poses: Array, rng: np.random.Generator) -> Track:
        """A run as the tracker tells it. `time_s` (n,) is the robot's clock, `poses` (n, 3)."""
        seen = np.arange(time_s[0] + 0.01, time_s[-1] - 0.01, 1 / self.rate_hz)
        seen = np.sort(seen + rng.uniform(-self.jitter, self.jitter, seen.size))
        seen = seen[rng.random(seen.size) >= self.lost]
        for _ in range(rng.poisson(self.gaps)):
            begin = rng.uniform(seen[0], seen[-1])
            seen = seen[(seen < begin) | (seen > begin + rng.uniform(0.05, 0.2))]
        x, y, yaw = (np.interp(seen, time_s, column) for column in poses.T)
        turn = turned("z", yaw)
        floor = turned("x", np.radians([self.floor_deg[0]])) @ turned(
            "y", np.radians([self.floor_deg[1]])
        )
        mount = np.eye(3)[None]
        for axis, angle in zip("zyx", self.mount_deg, strict=True):
            mount = mount @ turned(axis, np.radians([angle]))
        place = np.stack([x, y, np.zeros_like(x)], 1) + turn @ [self.ahead, self.left, self.up]
        place = (floor @ place[..., None])[..., 0] + [0.4, -1.1, 0.02]
        place = place + rng.normal(0, self.noise, place.shape)
        place[rng.random(seen.size) < self.wrong] += rng.normal(0, 0.4, 3)
        shaken = np.eye(3) + skew(rng.normal(0, np.radians(self.noise_deg), (seen.size, 3)))
        attitude = quaternions(floor @ shaken @ turn @ mount)
        return Track(self.ahead_s + seen * (1 + self.drift), place, attitude)


@dataclass(frozen=True)
class Session:
    """What is driven. Runs come one after the other with pauses; nothing is rounded to a grid."""

    schedules: dict[str, Schedule] = field(
        default_factory=lambda: {one.name: ((10.0, one.left, one.right),) for one in MANEUVERS}
    )
    repetitions: int = 10
    stand_s: float = 0.7
    pause_s: float = 8.0
    maps: WheelMaps = field(default_factory=WheelMaps)

    def shortened(self, seconds: float, repetitions: int) -> "Session":
        """The same maneuvers, each with one piece of this length."""
        cut = {n: tuple((seconds, a, b) for _, a, b in s) for n, s in self.schedules.items()}
        return replace(self, schedules=cut, repetitions=repetitions)


def record(
    robot: PlanarRobot,
    session: Session | None = None,
    tracker: Tracker | None = None,
    seed: int = 0,
) -> ManeuverRecording:
    """Drive a session and watch it."""
    session, tracker = session or Session(), tracker or Tracker()
    rng = np.random.default_rng(seed)
    told: list[tuple[str, int, float, Array]] = []
    clock = 100.0
    for name, schedule in session.schedules.items():
        for repetition in range(1, session.repetitions + 1):
            plan = np.array(schedule)
            plan[:, 0] += rng.uniform(-0.01, 0.01, len(plan))
            told.append((name, repetition, clock, plan))
            clock += plan[:, 0].sum() + session.pause_s + rng.uniform(0, 2)
    length = max(plan[:, 0].sum() for *_, plan in told) + 2 * session.stand_s
    grid = np.arange(round(length / STEP_S), dtype=np.float64) * STEP_S - session.stand_s
    duty = np.array([_duty(grid - robot.delay, plan, session.maps) for *_, plan in told])
    poses, _ = robot.drive(duty, _strength(robot, len(told), grid.size, rng))
    runs: list[Run] = []
    for (name, repetition, start, plan), path in zip(told, poses, strict=True):
        edges = start + np.concatenate([[0.0], np.cumsum(plan[:, 0])])
        commands = CommandSeries(edges, np.append(plan[:, 1], 0), np.append(plan[:, 2], 0))
        last = grid <= plan[:, 0].sum() + session.stand_s
        placed = put_down(path, rng)
        track = tracker.watch(start + STEP_S + grid[last], placed[last], rng)
        runs.append(Run(len(runs) + 1, name, repetition, commands, track))
    return ManeuverRecording("planar", session.maps, tuple(runs), tracker.ahead_s)


def _duty(time_s: Array, plan: Array, maps: WheelMaps) -> Array:
    ends = np.cumsum(plan[:, 0])
    rows = [(0.0, 0.0), *(pwm_duties(maps.duties(to_steps(a, b))) for _, a, b in plan), (0.0, 0.0)]
    piece = np.searchsorted(ends, time_s, side="right") + 1
    return np.array(rows)[np.where(time_s < 0, 0, piece)]


def _strength(robot: PlanarRobot, runs: int, steps: int, rng: np.random.Generator) -> Array:
    seconds = np.arange(steps) * STEP_S
    knots = np.arange(0, seconds[-1] + 2)
    result = np.empty((runs, steps, 2))
    for run in range(runs):
        for side in (0, 1):
            bumps = np.interp(seconds, knots, rng.normal(0, robot.wander, knots.size))
            result[run, :, side] = 1 + rng.normal(0, robot.repeat) + bumps
    return result


def put_down(path: Array, rng: np.random.Generator) -> Array:
    """The path from some place on the floor, in some direction."""
    x, y, yaw = rng.uniform(-0.5, 0.5), rng.uniform(-0.5, 0.5), rng.uniform(-np.pi, np.pi)
    c, s = np.cos(yaw), np.sin(yaw)
    moved = path @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    return moved + np.array([x, y, yaw])


def turned(axis: str, angle_rad: Array) -> Array:
    """Rotation matrices about x, y or z. Shape (n, 3, 3)."""
    i = "xyz".index(axis)
    j, k = (i + 1) % 3, (i + 2) % 3
    result = np.zeros((len(angle_rad), 3, 3))
    result[:, i, i] = 1
    result[:, j, j] = result[:, k, k] = np.cos(angle_rad)
    result[:, k, j] = np.sin(angle_rad)
    result[:, j, k] = -result[:, k, j]
    return result


def skew(vector: Array) -> Array:
    """Cross-product matrices. Shape (n, 3, 3)."""
    x, y, z = vector.T
    o = np.zeros_like(x)
    return np.stack([[o, -z, y], [z, o, -x], [-y, x, o]]).transpose(2, 0, 1)


def quaternions(matrices: Array) -> Array:
    """Attitudes as unit quaternions, w first. `matrices` may be a little off orthogonal."""
    m = matrices.transpose(1, 2, 0)
    candidates = np.stack(
        [
            [
                1 + m[0, 0] + m[1, 1] + m[2, 2],
                m[2, 1] - m[1, 2],
                m[0, 2] - m[2, 0],
                m[1, 0] - m[0, 1],
            ],
            [
                m[2, 1] - m[1, 2],
                1 + m[0, 0] - m[1, 1] - m[2, 2],
                m[0, 1] + m[1, 0],
                m[0, 2] + m[2, 0],
            ],
            [
                m[0, 2] - m[2, 0],
                m[0, 1] + m[1, 0],
                1 - m[0, 0] + m[1, 1] - m[2, 2],
                m[1, 2] + m[2, 1],
            ],
            [
                m[1, 0] - m[0, 1],
                m[0, 2] + m[2, 0],
                m[1, 2] + m[2, 1],
                1 - m[0, 0] - m[1, 1] + m[2, 2],
            ],
        ]
    )
    best = np.einsum("iik->ik", candidates).argmax(axis=0)
    chosen = candidates[best, :, np.arange(best.size)]
    return chosen / np.linalg.norm(chosen, axis=1, keepdims=True)
