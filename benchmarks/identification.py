"""How well robots are identified, and how long it takes.

python benchmarks/identification.py [--recording FOLDER]... [--truth NAME]... [--unseen]
    [--random N] [--repetitions 10] [--json] [-o docs/results/identification.md]
"""

import argparse
import dataclasses
import json
import os
import resource
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # for the truths in tests/

from identification_page import page
from steady_rates import Rates, steady_rates
from unseen_robots import UNSEEN

from mbot_protocol.drive.actions import WheelMaps
from mbot_workstation.measure.identification.fit import identify
from mbot_workstation.measure.identification.result import Identification
from mbot_workstation.measure.identification.rollout import simulate_run
from mbot_workstation.measure.tracks.maneuver import MANEUVERS
from mbot_workstation.measure.tracks.recording_folder import read_maneuvers
from mbot_workstation.measure.tracks.run import CommandSeries, ManeuverRecording, Run
from mbot_workstation.measure.tracks.track import Track
from mbot_workstation.sim.body.parameter_table import with_values
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from tests.workstation.mujoco_truth import record_simulated
from tests.workstation.planar_robot import PlanarRobot, Session, record

ABOUT = """\
Eight maneuvers of 10 s. *aspen*, *birch* and *cedar* are recordings of six repetitions from a
simulator that is not MuJoCo and shares no code with the project: motors with sag and dry
friction, tyres that slip, a caster, a battery that fades, runs that begin 0.15 to 0.45 s before
the robot moves. The other robots are made by the planar simulator of the tests (planar_robot.py),
ten repetitions: curved dead bands, Coulomb friction in motors and caster, tyres that creep and
slide, motors that scatter from run to run and wander within each. *Brush* and *carpet* are two
more simulators (unseen_robots.py; six repetitions): circuits, gears with play, one battery that
runs down and tyres with a peak; and servos that warm up, on a sloping carpet with a pile, with a
swivel caster that kicks. They were written without looking at the identification, and their
parameters were chosen before any of their robots was identified. The tracker has 4 mm and 0.3
degrees of noise, loses poses, sits off-centre and tilted, on a clock of its own. "mujoco" is a
truth from our own model. All of it is simulated; nothing was measured on a real robot yet.
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
        m.name: steady_rates(one[:, 0], one[:, 1], 0.0005)
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
        result[one.name] = steady_rates(forward, np.diff(yaw) / 0.005, 0.005)
    return result


def recorded_rates(folder: Path) -> Rates:
    """What a recording's truth.json says."""
    told = json.loads((folder / "truth.json").read_text())["manoeuvres"]
    result: Rates = {}
    for one in MANEUVERS:
        row = told[f"{one.left:.0f},{one.right:.0f}"]
        times = row["tau_speed_s"], row["tau_turn_s"]
        result[one.name] = (row["speed_m_s"], row["turn_rad_s"], *times)
    return result


def compare(truth: Rates, found: Identification) -> dict[str, float]:
    """Largest errors over all eight maneuvers, in percent of the fastest; what is told inside."""
    mine = simulated_rates(found.robot)
    full = max(abs(rates[0]) for rates in truth.values())
    fastest = max(abs(rates[1]) for rates in truth.values())
    told = {one.maneuver: one for one in found.steady}
    speed, turn, time, inside = [], [], [], []
    for name, (true_speed, true_turn, true_tau_s, true_turn_tau_s) in truth.items():
        speed.append(abs(mine[name][0] - true_speed) / full)
        turn.append(abs(mine[name][1] - true_turn) / fastest)
        if true_tau_s is not None and abs(true_speed) > full / 4:
            time.append(abs((mine[name][2] or np.inf) / true_tau_s - 1))
        if abs(true_turn) > fastest / 4:
            time.append(abs(mine[name][3] / true_turn_tau_s - 1))
        if name in told:
            inside.append(abs(told[name].speed_m_s - true_speed) < 1.96 * told[name].speed_sd)
            inside.append(abs(told[name].turn_rad_s - true_turn) < 1.96 * told[name].turn_sd)
    return {
        "speed_percent": 100 * max(speed),
        "turn_rate_percent": 100 * max(turn),
        "time_constant_percent": 100 * float(np.median(time)),
        "inside_percent": 100 * float(np.mean(inside)),
    }


def measure(recording: ManeuverRecording, truth: Rates) -> dict[str, Any]:
    cpu_s, start_s = time.process_time(), time.perf_counter()
    found = identify([recording], RobotParameters(), robot_id="benchmark")
    wall_s, cpu_s = time.perf_counter() - start_s, time.process_time() - cpu_s
    errors = compare(truth, found)
    repeats = {one.maneuver: one.place_m for one in found.repeatability}
    before, after = (
        float(np.sqrt(np.mean([getattr(e, name) ** 2 for e in found.errors])))
        for name in ("before_m", "after_m")
    )
    scatter = float(np.sqrt(np.mean([repeats[e.maneuver] ** 2 for e in found.errors])))
    return {
        "runs": len(recording.runs),
        "wall_s": round(wall_s, 1),
        "cpu_s": round(cpu_s, 1),
        **{name: round(error, 2) for name, error in errors.items()},
        "path_cm_before": round(100 * before, 1),
        "path_cm_after": round(100 * after, 1),
        "path_cm_repeats": round(100 * scatter, 1),
        "path_ratio": round(after / scatter, 2),
        "misfit_percent": round(100 * max(one.size for one in found.misfits), 2),
        "left_out": {name: one.why for name, one in found.excluded.items()},
        "parameters": {e.name: (e.value, e.low, e.high) for e in found.estimates},
    }


def _show(name: str, result: dict[str, Any]) -> None:
    print(
        f"{name}: {result['runs']} runs, {result['wall_s']} s ({result['cpu_s']} s of processor)\n"
        f"  off by at most: speed {result['speed_percent']} %, turn rate "
        f"{result['turn_rate_percent']} % of the fastest; time constants "
        f"{result['time_constant_percent']} %; inside {result['inside_percent']:.0f} %\n"
        f"  held out, after 10 s: {result['path_cm_before']} -> {result['path_cm_after']} cm "
        f"(repeats to {result['path_cm_repeats']}: {result['path_ratio']} times); "
        f"model misses {result['misfit_percent']} %",
        flush=True,
    )
    for run, why in result["left_out"].items():
        print(f"  left out {run}: {why}")


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--truth", action="append", default=[], choices=[*PLANAR, "mujoco"])
    parser.add_argument(
        "--recording", action="append", default=[], type=Path, help="a folder with a truth.json"
    )
    parser.add_argument("--unseen", action="store_true", help="the robots of unseen_robots.py")
    parser.add_argument("--random", type=int, default=0, help="so many random robots besides")
    parser.add_argument("--repetitions", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("-o", "--output", type=Path, help="write the tables to this file")
    options = parser.parse_args()
    session = dataclasses.replace(Session(), repetitions=options.repetitions)
    results: dict[str, dict[str, Any]] = {}
    if not options.json:
        print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")

    def keep(name: str, result: dict[str, Any]) -> None:
        results[name] = result
        if options.output is not None:  # each time, lest an hour's work be lost
            options.output.write_text(page(results, ABOUT))
        if not options.json:
            _show(name, result)

    for folder in options.recording:
        keep(folder.name, measure(read_maneuvers(folder), recorded_rates(folder)))
    truths = {name: PLANAR[name] for name in options.truth if name in PLANAR}
    truths |= {f"random {seed}": random_truth(seed) for seed in range(options.random)}
    for name, truth in truths.items():
        recording = record(truth, session, seed=options.seed)
        keep(name, measure(recording, planar_rates(truth)))
    for name, robot in UNSEEN.items() if options.unseen else ():
        keep(name, measure(robot.record(options.seed), robot.rates()))
    if "mujoco" in options.truth:
        recording = record_simulated(MUJOCO, session, seed=options.seed)
        keep("mujoco", measure(recording, simulated_rates(MUJOCO)))
    if options.json:
        print(json.dumps(results))
    else:
        peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        print(f"largest memory {peak_mb:.0f} MB")


if __name__ == "__main__":
    main()
