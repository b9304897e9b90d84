"""Recordings of a robot simulated by our own MuJoCo model, watched by `planar_robot`'s tracker."""

import numpy as np

from mbot_workstation.measure.identification.rollout import (
    simulate_paths,
    step_count,
    wheel_volts,
)
from mbot_workstation.measure.tracks.run import CommandSeries, ManeuverRecording, Run
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.engine import TIMESTEP_S

from .planar_robot import Session, Tracker, put_down


def record_simulated(
    robot: RobotParameters,
    session: Session,
    tracker: Tracker | None = None,
    *,
    delay_s: float = 0.03,
    repeat: float = 0.003,
    seed: int = 0,
) -> ManeuverRecording:
    """Drive a session; each motor's strength differs by `repeat` (sd, a share) from run to run."""
    tracker = tracker or Tracker()
    rng = np.random.default_rng(seed)
    plans: list[tuple[str, int, CommandSeries]] = []
    clock_s = 100.0
    for name, schedule in session.schedules.items():
        for repetition in range(1, session.repetitions + 1):
            plan = np.array(schedule)
            edges_s = clock_s + np.concatenate([[0.0], np.cumsum(plan[:, 0])])
            series = CommandSeries(edges_s, np.append(plan[:, 1], 0), np.append(plan[:, 2], 0))
            plans.append((name, repetition, series))
            clock_s = edges_s[-1] + session.pause_s
    steps = max(step_count(series) for *_, series in plans)
    volts = np.array([wheel_volts(robot, series, session.maps, steps) for *_, series in plans])
    volts *= 1 + rng.normal(0, repeat, (len(plans), 1, 2))
    paths = simulate_paths([robot] * len(plans), volts)
    runs: list[Run] = []
    for (name, repetition, series), path in zip(plans, paths, strict=True):
        count = step_count(series) + 1
        standing = round((session.stand_s + delay_s) / TIMESTEP_S)
        whole = np.concatenate([np.zeros((standing, 3)), path[:count]])
        began_s = series.start_s - session.stand_s
        time_s = (began_s + TIMESTEP_S * np.arange(len(whole))).astype(np.float64)
        track = tracker.watch(time_s, put_down(whole, rng), rng)
        runs.append(Run(len(runs) + 1, name, repetition, series, track))
    return ManeuverRecording("simulated", session.maps, tuple(runs), tracker.ahead_s)
