"""How well robots are identified, and how long it takes.

python benchmarks/identification.py [--truth NAME]... [--random N] [--repetitions 10]
    [--json] [-o docs/results/identification.md]
"""

import argparse
import dataclasses
import json
import os
import resource
import shlex
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # for the truths in tests/

from identification_page import page

from mbot_protocol.actions import WheelMaps
from mbot_workstation.identification.fit import identify
from mbot_workstation.identification.model import simulate_run
from mbot_workstation.identification.result import Identification
from mbot_workstation.recordings.maneuver import MANEUVERS
from mbot_workstation.recordings.run import CommandSeries, Recording, Run
from mbot_workstation.recordings.track import Track
from mbot_workstation.simulation.parameter_table import with_values
from mbot_workstation.simulation.robot_parameters import RobotParameters
from tests.workstation.mujoco_truth import record_simulated
from tests.workstation.planar_robot import PlanarRobot, Session, record

ABOUT = """\
Eight manoeuvres of 10 s, ten repetitions, half of them fitted. The robots are made by a planar
simulator that is not MuJoCo (tests/workstation/planar_robot.py): curved dead bands, Coulomb
friction in motors and caster, tyres that creep and slide, motors that scatter from run to run and
wander within each. The tracker: 4 mm and 0.3 degrees of noise, 90 Hz with jitter, losses, gaps and
outliers, off-centre, tilted, over a floor that is not level, with a clock of its own. "mujoco" is
a truth from our own model.
"""

PLANAR = {
    "planar": PlanarRobot(),
    "weak right motor": PlanarRobot(top_speed=(0.43, 0.215)),
    "sluggish": PlanarRobot(lag=(0.2, 0.2)),
    "quick": PlanarRobot(lag=(0.055, 0.06), top_speed=(0.36, 0.37)),
    "slippery": PlanarRobot(grip=0.2, lag=(0.08, 0.08)),
    "wide track": PlanarRobot(track=0.135, inertia=0.005),
    "little friction": PlanarRobot(friction=(0.002, 0.002), drag=0.03, threshold=(0.2, 0.2)),
    "uneven days": PlanarRobot(repeat=0.015, wander=0.015),
    "weaker backward": PlanarRobot(backward=(0.985, 0.975)),
    "late": PlanarRobot(delay=0.2),
}

MUJOCO = with_values(
    RobotParameters(),
    {
        "left_gain": 0.95,
        "right_gain": 1.04,
        "left_time_constant_s": 0.08,
        "right_time_constant_s": 0.07,
        "track_m": 0.117,
        "mass_ahead_m": 0.018,
        "inertia_scale": 1.2,
        "left_dry_friction": 0.1,
        "right_dry_friction": 0.1,
    },
)

STRAIGHT = ("forward-forward", "backward-backward")

Rates = dict[str, tuple[float, float, float]]
"""Of each manoeuvre: forward speed [m/s], turn rate [rad/s], lag behind the steady motion [s]."""


def random_truth(seed: int) -> PlanarRobot:
    """A robot as it may come along."""
    rng = np.random.default_rng(seed)
    top = 0.41 * rng.uniform(0.85, 1.12)
    return PlanarRobot(
        top_speed=(top * rng.uniform(0.95, 1.05), top * rng.uniform(0.95, 1.05)),
        lag=(rng.uniform(0.06, 0.14), rng.uniform(0.06, 0.14)),
        threshold=(rng.uniform(0.15, 0.24), rng.uniform(0.15, 0.24)),
        bend=rng.uniform(0.8, 1.1),
        friction=(rng.uniform(0, 0.02), rng.uniform(0, 0.02)),
        mass=rng.uniform(0.8, 1.1),
        inertia=rng.uniform(0.002, 0.004),
        track=rng.uniform(0.108, 0.122),
        grip=rng.uniform(0.6, 1.0),
        creep=rng.uniform(0.004, 0.008),
        drag=rng.uniform(0.0, 0.15),
        delay=rng.uniform(0.01, 0.05),
        repeat=rng.uniform(0.001, 0.006),
        wander=rng.uniform(0.001, 0.006),
    )


def planar_rates(robot: PlanarRobot) -> Rates:
    duty = np.array([np.tile([m.left, m.right], (8000, 1)) for m in MANEUVERS])
    _, speeds = robot.drive(duty, np.ones_like(duty))
    return {
        m.name: _rates(one[:, 0], one[:, 1], 0.0005)
        for m, one in zip(MANEUVERS, speeds, strict=True)
    }


def simulated_rates(robot: RobotParameters) -> Rates:
    result: Rates = {}
    still = Track(np.array([0.0, 1.0]), np.zeros((2, 3)), np.tile([1.0, 0, 0, 0], (2, 1)))
    for one in MANEUVERS:
        commands = CommandSeries(
            np.array([0.0, 4.0]), np.array([one.left, 0]), np.array([one.right, 0])
        )
        path = simulate_run(robot, Run(1, one.name, 1, commands, still), WheelMaps())
        yaw = path.yaw_rad[:801]
        step = np.diff(path.position_m[:801, 0] + 1j * path.position_m[:801, 1])
        forward = (step * np.exp(-0.5j * (yaw[1:] + yaw[:-1]))).real / 0.005
        result[one.name] = _rates(forward, np.diff(yaw) / 0.005, 0.005)
    return result


def _rates(forward: Any, turn: Any, step_s: float) -> tuple[float, float, float]:
    late = len(forward) // 2
    speed, rate = float(forward[late:].mean()), float(turn[late:].mean())
    moving, steady = (forward, speed) if abs(speed) > 0.25 else (turn, rate)
    return speed, rate, float((1 - moving / steady).sum() * step_s)


def asymmetry(rates: Rates, track_m: float) -> float:
    """Left wheel's speed by the right one's, told to drive straight."""
    speed, rate, _ = rates["forward-forward"]
    return (speed - rate * track_m / 2) / (speed + rate * track_m / 2)


def compare(truth: Rates, found: Rates, track_m: float) -> dict[str, float]:
    """Largest errors over all manoeuvres, in percent; speeds of the two straight ones."""
    speed, rate, lag = [], [], []
    for name, (true_speed, true_rate, true_lag) in truth.items():
        if name in STRAIGHT:
            speed.append(found[name][0] / true_speed - 1)
        if abs(true_rate) > 1:
            rate.append(found[name][1] / true_rate - 1)
        lag.append(found[name][2] / true_lag - 1)
    ratio = asymmetry(found, track_m) / asymmetry(truth, track_m) - 1
    largest = (max(abs(e) for e in errors) for errors in (speed, rate, lag))
    names = ("speed_percent", "turn_rate_percent", "time_constant_percent")
    errors = {name: 100 * error for name, error in zip(names, largest, strict=True)}
    return errors | {"asymmetry_percent": 100 * abs(ratio)}


def measure(recording: Recording, truth: Rates, track_m: float) -> dict[str, Any]:
    cpu_s, start_s = time.process_time(), time.perf_counter()
    found = identify([recording], RobotParameters(), robot_id="benchmark")
    wall_s, cpu_s = time.perf_counter() - start_s, time.process_time() - cpu_s
    errors = compare(truth, simulated_rates(found.robot), track_m)
    return {
        "runs": len(recording.runs),
        "wall_s": round(wall_s, 1),
        "cpu_s": round(cpu_s, 1),
        **{name: round(error, 2) for name, error in errors.items()},
        **_held_out(found),
        "left_out": found.left_out,
        "parameters": {e.name: (e.value, e.low, e.high) for e in found.estimates},
    }


def _held_out(found: Identification) -> dict[str, float]:
    straight = [error for error in found.errors if error.maneuver in STRAIGHT]
    repeats = {one.maneuver: one for one in found.repeatability}

    def median_of(name: str, errors: Any, factor: float) -> float:
        return round(factor * float(np.median([getattr(e, name) for e in errors])), 1)

    return {
        "straight_cm_before": median_of("before_m", straight, 100),
        "straight_cm_after": median_of("after_m", straight, 100),
        "straight_cm_repeats": round(
            100 * float(np.mean([repeats[e.maneuver].place_m for e in straight])), 1
        ),
        "place_cm_before": median_of("before_m", found.errors, 100),
        "place_cm_after": median_of("after_m", found.errors, 100),
        "heading_deg_before": median_of("before_rad", found.errors, 180 / np.pi),
        "heading_deg_after": median_of("after_rad", found.errors, 180 / np.pi),
        "heading_deg_repeats": round(
            float(np.degrees(np.median([one.heading_rad for one in found.repeatability]))), 1
        ),
    }


def _show(name: str, result: dict[str, Any]) -> None:
    print(
        f"{name}: {result['runs']} runs, {result['wall_s']} s ({result['cpu_s']} s of processor)\n"
        f"  off by at most: speed {result['speed_percent']} %, turn rate "
        f"{result['turn_rate_percent']} %, time constant {result['time_constant_percent']} %, "
        f"asymmetry {result['asymmetry_percent']} %\n"
        f"  held out, straight, 10 s: {result['straight_cm_before']} -> "
        f"{result['straight_cm_after']} cm (repeats to {result['straight_cm_repeats']})\n"
        f"  held out, all: {result['place_cm_before']} -> {result['place_cm_after']} cm, "
        f"{result['heading_deg_before']} -> {result['heading_deg_after']} degrees "
        f"(repeats to {result['heading_deg_repeats']})",
        flush=True,
    )
    for run, why in result["left_out"].items():
        print(f"  left out {run}: {why}")


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--truth", action="append", choices=[*PLANAR, "mujoco"])
    parser.add_argument("--random", type=int, default=0, help="so many random robots besides")
    parser.add_argument("--repetitions", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("-o", "--output", type=Path, help="write the tables to this file")
    options = parser.parse_args()
    truths = {name: PLANAR[name] for name in options.truth or PLANAR if name in PLANAR}
    truths |= {f"random {seed}": random_truth(seed) for seed in range(options.random)}
    session = dataclasses.replace(Session(), repetitions=options.repetitions)
    results: dict[str, dict[str, Any]] = {}
    if not options.json:
        print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")

    def keep(name: str, result: dict[str, Any]) -> None:
        results[name] = result
        if options.output is not None:  # each time, lest an hour's work be lost
            command = shlex.join(["python", "benchmarks/identification.py", *sys.argv[1:]])
            options.output.write_text(page(results, command, ABOUT))
        if not options.json:
            _show(name, result)

    for name, truth in truths.items():
        recording = record(truth, session, seed=options.seed)
        keep(name, measure(recording, planar_rates(truth), truth.track))
    if options.truth is None or "mujoco" in options.truth:
        recording = record_simulated(MUJOCO, session, seed=options.seed)
        keep("mujoco", measure(recording, simulated_rates(MUJOCO), MUJOCO.track_m))
    if options.json:
        print(json.dumps(results))
    else:
        peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        print(f"largest memory {peak_mb:.0f} MB")


if __name__ == "__main__":
    main()
