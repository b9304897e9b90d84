"""A robot that is not MuJoCo's: a planar unicycle with two slow motors, and a tracker on it."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from mbot_workstation.measure.tracks.maneuver import MANEUVERS, Maneuver
from mbot_workstation.measure.tracks.run import CommandSeries, Run
from mbot_workstation.measure.tracks.track import Array, Track

STEP_S = 0.002


@dataclass(frozen=True)
class Tracker:
    """How the tracker sits, and how good it is."""

    ahead_m: float = 0.03
    left_m: float = -0.015
    height_m: float = 0.12
    mount_wxyz: tuple[float, float, float, float] = (0.995, 0.03, -0.04, 0.085)
    rate_hz: float = 90.0
    position_noise_m: float = 0.004
    angle_noise_rad: float = np.radians(0.3)
    time_jitter_s: float = 0.001
    lost_share: float = 0.02
    clock_ahead_s: float = -7000.0
    world_yaw_rad: float = 1.0


@dataclass(frozen=True)
class Robot:
    left_mps: float = 0.41
    right_mps: float = 0.39
    time_constant_s: float = 0.09
    delay_s: float = 0.03
    track_m: float = 0.117
    tracker: Tracker = field(default_factory=Tracker)


def commands(maneuver: Maneuver, start_s: float, duration_s: float) -> CommandSeries:
    return CommandSeries(
        np.array([start_s - 1.0, start_s, start_s + duration_s]),
        np.array([0.0, maneuver.left, 0.0]),
        np.array([0.0, maneuver.right, 0.0]),
    )


def path(robot: Robot, series: Sequence[CommandSeries], times_s: Array, carried: bool) -> Array:
    """x, y, yaw at `times_s` of the robot's clock. Shape (n, 3)."""
    grid = np.arange(times_s[0], times_s[-1] + STEP_S, STEP_S)
    left, right = np.zeros_like(grid), np.zeros_like(grid)
    for one in series:
        told = one.at(grid - robot.delay_s)
        left, right = left + told[0] * robot.left_mps, right + told[1] * robot.right_mps
    share = STEP_S / robot.time_constant_s
    speeds = np.zeros((len(grid), 2))
    for i in range(1, len(grid)):
        speeds[i] = speeds[i - 1] + share * (np.array([left[i], right[i]]) - speeds[i - 1])
    forward, turn = speeds.mean(axis=1), (speeds[:, 1] - speeds[:, 0]) / robot.track_m
    yaw = np.cumsum(turn) * STEP_S
    x = np.cumsum(forward * np.cos(yaw)) * STEP_S
    y = np.cumsum(forward * np.sin(yaw)) * STEP_S
    if carried:  # back to the start between runs, through the air
        for one in series[1:]:
            moment = one.start_s - 2.0
            share_done = np.clip((grid - moment) / 0.8, 0, 1)
            at = int(np.searchsorted(grid, moment))
            x, y = x - share_done * x[at], y - share_done * y[at]
    return np.stack([np.interp(times_s, grid, values) for values in (x, y, yaw)], axis=1)


def track_of(
    robot: Robot, series: Sequence[CommandSeries], seed: int, carried: bool = False
) -> Track:
    random = np.random.default_rng(seed)
    tracker = robot.tracker
    start_s, end_s = series[0].start_s - 1.0, series[-1].end_s + 1.0
    true_s = np.arange(start_s, end_s, 1 / tracker.rate_hz)
    true_s = true_s + random.uniform(-1, 1, len(true_s)) * tracker.time_jitter_s
    true_s = np.sort(true_s[random.random(len(true_s)) >= tracker.lost_share])
    x, y, yaw = path(robot, series, true_s, carried).T
    yaw = yaw + tracker.world_yaw_rad
    cosine, sine = np.cos(tracker.world_yaw_rad), np.sin(tracker.world_yaw_rad)
    x, y = cosine * x - sine * y, sine * x + cosine * y
    x = x + tracker.ahead_m * np.cos(yaw) - tracker.left_m * np.sin(yaw)
    y = y + tracker.ahead_m * np.sin(yaw) + tracker.left_m * np.cos(yaw)
    position = np.stack([x + 1.5, y - 0.7, np.full_like(x, tracker.height_m)], axis=1)
    position += random.normal(0, tracker.position_noise_m, position.shape)
    mount = Rotation.from_quat(tracker.mount_wxyz, scalar_first=True)
    noise = Rotation.from_rotvec(random.normal(0, tracker.angle_noise_rad, (len(yaw), 3)))
    attitude = Rotation.from_euler("z", yaw[:, None]) * mount * noise
    return Track(true_s + tracker.clock_ahead_s, position, attitude.as_quat(scalar_first=True))


def session(
    robot: Robot | None = None,
    repetitions: int = 2,
    duration_s: float = 4.0,
    maneuvers: Sequence[Maneuver] = MANEUVERS,
    seed: int = 0,
) -> tuple[Run, ...]:
    """Runs with a track each."""
    robot = robot or Robot()
    runs: list[Run] = []
    start_s = 5000.0
    for repetition in range(1, repetitions + 1):
        for maneuver in maneuvers:
            number = len(runs) + 1
            series = commands(maneuver, start_s, duration_s)
            track = track_of(robot, [series], seed + number)
            runs.append(Run(number, maneuver.name, repetition, series, track))
            start_s += duration_s + 4.0 + (number * 0.37) % 1
    return tuple(runs)
