"""Runs that were not fitted: which they are, and how far the simulation ends from them."""

import math
from collections.abc import Sequence
from statistics import median

import numpy as np

from mbot_workstation.measure.identification.floor import Plane
from mbot_workstation.measure.identification.observed_run import ObservedRun, maneuvers
from mbot_workstation.measure.identification.prediction import moments_s, simulated_at
from mbot_workstation.measure.identification.result import Repeatability, RunError
from mbot_workstation.measure.identification.rollout import Plan, rollouts
from mbot_workstation.measure.tracks.track import Array
from mbot_workstation.sim.body.robot_parameters import RobotParameters

LEAST_TURNS_RAD = 2 * math.pi
"""From one turn on, a heading's error is told as a share of what was turned."""

AT_S = 10.0
"""After the first command, or at the last one if that comes sooner."""

NEAREST = 9
"""Samples that are averaged for a moment: a tenth of a second at 90 Hz."""


def is_held_out(runs: Sequence[ObservedRun]) -> list[bool]:
    """Every other repetition of each maneuver, the first one kept for the fit."""
    result = [False] * len(runs)
    for members in maneuvers(runs).values():
        order = sorted(
            members,
            key=lambda i: (
                runs[i].flat.recording,
                runs[i].flat.run.repetition,
                runs[i].flat.run.number,
            ),
        )
        for index in order[1::2]:
            result[index] = True
    return result


def axle_path(run: ObservedRun, setting: Array, delay_s: float) -> tuple[Plane, Array, Array]:
    """Where the axle's centre was, the heading, and when: from where the run began, along +x.

    Args:
        run: measured.
        setting: of its recording, shape (6,).
        delay_s: than the other runs.

    Returns:
        Points [m], angles [rad] and seconds since the first command took effect, each (n,).

    """
    when_s = moments_s(run, setting, delay_s)
    heading = run.heading - setting[4]
    axle = run.place - np.exp(1j * heading) * complex(setting[2], setting[3])
    early = when_s < max(when_s[0] + 0.15, 0.0)
    turn = float(np.median(heading[early]))
    start = complex(np.median(axle[early].real), np.median(axle[early].imag))
    return (axle - start) * np.exp(-1j * turn), heading - turn, when_s


def held_out_errors(
    runs: Sequence[ObservedRun],
    plans: Sequence[Plan],
    which: Sequence[int],
    settings: Array,
    delay_s: Array,
    before: RobotParameters,
    after: RobotParameters,
) -> tuple[RunError, ...]:
    """Drive each run with both robots from where it began, and compare the ends.

    Args:
        runs: held out.
        plans: all plans; which: each run's.
        settings: of the recordings, shape (recordings, 6).
        delay_s: of each run, than the others of its clock, shape (runs,).
        before, after: the robots.

    """
    old, new = rollouts([before, after], plans)
    result: list[RunError] = []
    for run, plan, delay in zip(runs, which, delay_s.tolist(), strict=True):
        axle, heading, when_s = axle_path(run, settings[run.flat.recording], delay)
        at_s = min(AT_S, float(when_s[-1]))
        near = np.argsort(np.abs(when_s - at_s))[:NEAREST]
        off = []
        for path in (old[plan], new[plan]):
            place, yaw = simulated_at(path, when_s[near])
            off.append((abs((axle[near] - place).mean()), abs(float((heading[near] - yaw).mean()))))
        (old_m, old_rad), (new_m, new_rad) = off
        turned = float(heading[near].mean())
        result.append(
            RunError(run.flat.name, run.maneuver, at_s, old_m, new_m, old_rad, new_rad, turned)
        )
    return tuple(result)


def repeatability(
    runs: Sequence[ObservedRun], settings: Array, delay_s: Array
) -> tuple[Repeatability, ...]:
    """How far repetitions are apart, for each maneuver that has at least two.

    Settings and `delay_s` are as in `errors`.
    """
    result: list[Repeatability] = []
    for name, members in maneuvers(runs).items():
        if len(members) < 2:
            continue
        paths = [
            axle_path(runs[i], settings[runs[i].flat.recording], float(delay_s[i])) for i in members
        ]
        at_s = min(AT_S, *(float(when_s[-1]) for *_, when_s in paths))
        ends = np.array([_at(path, at_s) for path in paths])
        off = ends - ends.mean(axis=0)
        spread = (np.abs(off) ** 2).sum(axis=0) / (len(members) - 1)
        place_m, heading_rad = np.sqrt(spread.real)
        result.append(Repeatability(name, float(place_m), float(heading_rad)))
    return tuple(result)


def heading_share(off_and_turned_rad: Sequence[tuple[float, float]]) -> float | None:
    """How far headings are off, as a share of the angle turned: the middle one of runs that turn.

    Args:
        off_and_turned_rad: of each run; runs of less than a turn don't count.

    """
    shares = [
        abs(off / turned) for off, turned in off_and_turned_rad if abs(turned) >= LEAST_TURNS_RAD
    ]
    return median(shares) if shares else None


def _at(path: tuple[Plane, Array, Array], at_s: float) -> tuple[complex, complex]:
    axle, heading, when_s = path
    near = np.argsort(np.abs(when_s - at_s))[:NEAREST]
    return complex(axle[near].mean()), complex(heading[near].mean())
