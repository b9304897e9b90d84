"""From a finished fit to values with intervals, to what can't be told, and to predicted driving."""

import numpy as np

from mbot_workstation.measure.identification.dataset import Dataset
from mbot_workstation.measure.identification.prediction import NUISANCE
from mbot_workstation.measure.identification.result import ParameterEstimate, SteadyRate
from mbot_workstation.measure.identification.rollout import STEADY_S, Plan, rollouts
from mbot_workstation.measure.identification.solver import Problem, Solution, VarianceComponents
from mbot_workstation.measure.tracks.track import Array
from mbot_workstation.sim.body.parameter_table import (
    BY_NAME,
    PARAMETERS,
    value,
    with_values,
)
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.effects.presets import KNOWN
from mbot_workstation.sim.engine import TIMESTEP_S

QUANTILE_95 = 1.96

TOLD_SHARE = 1 / 3
"""Of the spread among real robots: what is known no better is not told."""

NOTHING_SHARE = 0.95
"""Of that spread: the recordings say nothing."""

TOGETHER = 0.7
"""Correlation from which on two parameters are told together only."""

DERIVATIVE_STEP = 0.05
"""Of a parameter's spread."""


def estimates(
    solution: Solution,
    problem: Problem,
    robot: RobotParameters,
    before: RobotParameters,
    fade: float,
) -> tuple[ParameterEstimate, ...]:
    """Of all parameters.

    Args:
        solution: evaluated, so that its covariance holds what the model misses.
        problem: what was solved.
        robot: what it came to, with a fresh battery.
        before: as it was known.
        fade: of the battery over the session, as repetitions show it.

    """
    sd = np.sqrt(np.diag(solution.covariance))
    result: list[ParameterEstimate] = []
    for known in PARAMETERS:
        found, was = value(robot, known.name), value(before, known.name)
        if known.name == "battery_fade":
            # Of a standard deviation from n numbers, 1 in the root of 2 n; the rest is its shape.
            half = QUANTILE_95 * fade / np.sqrt(len(problem.runs) / 2)
            result.append(
                ParameterEstimate(known.name, fade, was, max(fade - half, 0.0), fade + half)
            )
        elif known.name not in problem.names:
            result.append(ParameterEstimate(known.name, found, was, why_not=known.fixed_because))
        elif sd[(index := problem.names.index(known.name))] > TOLD_SHARE:
            why = _why_not(solution.covariance, index, problem.names)
            result.append(ParameterEstimate(known.name, found, was, why_not=why))
        else:
            half = QUANTILE_95 * float(sd[index]) * known.spread
            low, high = max(found - half, known.low), min(found + half, known.high)
            result.append(
                ParameterEstimate(known.name, found, was, min(low, found), max(high, found))
            )
    return tuple(result)


def _why_not(covariance: Array, index: int, names: tuple[str, ...]) -> str:
    sd = np.sqrt(np.diag(covariance))
    if sd[index] > NOTHING_SHARE:
        return "it changes nothing in these runs"
    together = covariance[index] / (sd * sd[index])
    others = [
        BY_NAME[name].words.partition(" [")[0]
        for other, name in enumerate(names)
        if other != index and abs(together[other]) > TOGETHER
    ]
    if others:
        return f"only together with {' and '.join(others)}"
    return "it changes too little in these runs"


def latency(
    solution: Solution, problem: Problem, data: Dataset, *, same_clock: bool
) -> ParameterEstimate:
    """From command to wheel [s], if the clocks were one."""
    before = KNOWN.action_latency_ms / 1000
    if not same_clock:
        why = (
            "a tracker whose clock is not the robot's shows the sum of this delay and the clocks' "
            "difference; record with one clock and give --same-clock"
        )
        return ParameterEstimate("latency_ms", before, before, why_not=why)
    guessed = {run.flat.recording: run.ahead_s for run in data.runs}
    found = [solution.state.settings[index, 0] + ahead_s for index, ahead_s in guessed.items()]
    delays_s = solution.state.nuisance[:, NUISANCE.index("delay")]
    middle = max(float(np.mean(found)), 0.0)
    scatter = float(delays_s.std()) / np.sqrt(max(len(problem.runs) - 1, 1))
    half = QUANTILE_95 * float(np.hypot(solution.setting_sd[0, 0], scatter))
    return ParameterEstimate("latency_ms", middle, before, max(middle - half, 0.0), middle + half)


def steady_rates(
    solution: Solution,
    problem: Problem,
    robot: RobotParameters,
    variances: VarianceComponents,
    fade: float,
) -> tuple[SteadyRate, ...]:
    """What the robot does in maneuvers of a single command, and how far a drive may be off."""
    chosen = [i for i, plan in enumerate(problem.plans) if _is_held(plan)]
    plans = [problem.plans[index] for index in chosen]
    names = [run.maneuver for run in problem.runs]
    if not plans:
        return ()
    steps = [
        with_values(robot, {n: value(robot, n) + DERIVATIVE_STEP * BY_NAME[n].spread})
        for n in problem.names
    ]
    driven = rollouts([robot, *steps], plans)
    rates = np.array(
        [[steady_rate(*one) for one in zip(paths, plans, strict=True)] for paths in driven]
    )
    jacobian = (rates[1:] - rates[0]) / DERIVATIVE_STEP
    fitted = np.einsum("ipr,ij,jpr->pr", jacobian, solution.covariance, jacobian)
    result: list[SteadyRate] = []
    for row, index in enumerate(chosen):
        speed, turn = rates[0, row]
        wheels = np.array([speed - turn * robot.track_m / 2, speed + turn * robot.track_m / 2])
        missed = variances.misfit * np.abs(wheels).max()
        each = float(missed**2 * 2 + (variances.motor**2 * wheels**2).sum())
        charge = fade / np.sqrt(12)
        speed_sd = np.sqrt(fitted[row, 0] + each / 4 + (charge * speed) ** 2)
        turn_sd = np.sqrt(fitted[row, 1] + each / robot.track_m**2 + (charge * turn) ** 2)
        name = names[problem.which.index(index)]
        result.append(SteadyRate(name, float(speed), float(turn), float(speed_sd), float(turn_sd)))
    return tuple(result)


def _is_held(plan: Plan) -> bool:
    """Whether it is one command, for long enough to be at speed."""
    commands = plan.commands
    driving = (commands.left != 0) | (commands.right != 0)
    told = set(zip(commands.left[driving].tolist(), commands.right[driving].tolist(), strict=True))
    return len(told) == 1 and commands.end_s - commands.start_s > 2 * STEADY_S


def steady_rate(path: Array, plan: Plan) -> tuple[float, float]:
    """Speed ahead [m/s] and turn rate [rad/s] before the last command.

    `path` is simulated: x, y [m], heading [rad], shape (steps + 1, 3).
    """
    end = round((plan.commands.end_s - plan.commands.start_s) / TIMESTEP_S)
    last = path[end - round(STEADY_S / TIMESTEP_S) : end + 1]
    step = np.diff(last[:, 0] + 1j * last[:, 1])
    ahead = (step * np.exp(-0.5j * (last[1:, 2] + last[:-1, 2]))).real
    return float(ahead.sum()) / STEADY_S, float(last[-1, 2] - last[0, 2]) / STEADY_S
