"""Recorded commands driven by the simulated robot: where our own MuJoCo model goes with them.

The floor is bare and endless, since a run of 10 s leaves the task's arena; everything else is the
model of `simulation/`, step for step.
"""

import importlib
import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mbot_protocol.drive.actions import WheelMaps, to_steps
from mbot_workstation.measure.tracks.run import CommandSeries, Run
from mbot_workstation.measure.tracks.track import Array, Track
from mbot_workstation.sim.body.motor import pwm_duties, wheel_voltages
from mbot_workstation.sim.body.robot_mjcf import add_floor_contacts, add_robot
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.engine import TIMESTEP_S, MjModel, mujoco

STOPPING_S = 0.6
"""Simulated beyond the last command: any motor of up to 200 ms has stopped nearly by then."""

SAME_S = 0.025
"""Commands that differ by less in time are the same plan: a person would not tell them apart, and
the run's own delay takes most of it up."""

SETTLED_S = 1.5
"""After which a robot drives steadily: seven time constants of a sluggish one."""

STEADY_S = 0.25
"""Of which the motion is repeated then."""

_UNNEEDED = ("SENSOR", "MIDPHASE", "ISLAND")
"""Stages that cost a third of a step and change nothing with five shapes (bit for bit)."""

_SETTLING_STEPS = 40
"""Standing, before the first command: the soft contacts take the weight."""


def simulate_run(robot: RobotParameters, run: Run, wheel_maps: WheelMaps) -> Track:
    """Where the simulated robot goes with a run's commands.

    Args:
        robot: as calibrated, or nominal.
        run: only its commands are used.
        wheel_maps: what the daemon made of actions when it was recorded.

    Returns:
        The axle's centre on the floor, every 5 ms from the first command until 0.6 s after the
        last. Its clock is the robot's, as if the wheels answered at once; it begins in the
        origin, heading along +x. `validation.axle_path` gives what was measured in that frame.

    """
    steps = step_count(run.commands)
    volts = wheel_volts(robot, run.commands, wheel_maps, steps)
    path = simulate_paths([robot], volts[None])[0]
    time_s = run.commands.start_s + TIMESTEP_S * np.arange(steps + 1, dtype=np.float64)
    position_m = np.column_stack([path[:, :2], np.zeros(steps + 1)])
    half = path[:, 2] / 2
    nothing = np.zeros(steps + 1)
    return Track(time_s, position_m, np.stack([np.cos(half), nothing, nothing, np.sin(half)], 1))


def step_count(commands: CommandSeries) -> int:
    """How many steps a run takes, from its first command until the robot has stopped."""
    return round((commands.end_s - commands.start_s + STOPPING_S) / TIMESTEP_S)


def wheel_volts(
    robot: RobotParameters, commands: CommandSeries, wheel_maps: WheelMaps, steps: int
) -> Array:
    """The voltage that turns each wheel during each step; a change within a step counts in part.

    Returns:
        Left and right, shape (steps, 2); step 0 begins with the first command.

    """
    rows = [
        pwm_duties(wheel_maps.duties(to_steps(left, right)))
        for left, right in zip(commands.left, commands.right, strict=True)
    ]
    volts = np.array([wheel_voltages(*row, robot) for row in rows])
    edges_s = commands.start_s + TIMESTEP_S * np.arange(steps + 1)
    held_s = np.diff(commands.time_s, append=max(edges_s[-1], commands.time_s[-1]) + 1)
    ends_s = np.append(commands.time_s, commands.time_s[-1] + held_s[-1])
    summed = np.vstack([np.zeros(2), np.cumsum(volts * held_s[:, None], axis=0)])
    upto = np.stack([np.interp(edges_s, ends_s, summed[:, side]) for side in (0, 1)], axis=1)
    return np.diff(upto, axis=0) / TIMESTEP_S


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """What a run was told. Runs that were told the same are simulated once.

    Attributes:
        commands: of the run that was driven longest.
        wheel_maps: what the daemon made of actions.

    """

    commands: CommandSeries
    wheel_maps: WheelMaps

    def is_like(self, other: "Plan") -> bool:
        """Whether the same values follow one another, at the same times but for the last."""
        mine, theirs = self.commands, other.commands
        return (
            self.wheel_maps == other.wheel_maps
            and len(mine.time_s) == len(theirs.time_s)
            and bool((mine.left == theirs.left).all() and (mine.right == theirs.right).all())
            and bool((np.abs(_since(mine) - _since(theirs))[:-1] < SAME_S).all())
        )


def plans_of(runs: Sequence[tuple[CommandSeries, WheelMaps]]) -> tuple[list[Plan], list[int]]:
    """The different plans among these, and which one each run followed."""
    plans: list[Plan] = []
    which: list[int] = []
    for commands, wheel_maps in runs:
        plan = Plan(commands, wheel_maps)
        index = next((i for i, known in enumerate(plans) if known.is_like(plan)), len(plans))
        if index == len(plans):
            plans.append(plan)
        elif _since(commands)[-1] > _since(plans[index].commands)[-1]:
            plans[index] = plan
        which.append(index)
    return plans, which


def _since(commands: CommandSeries) -> Array:
    return commands.time_s - commands.start_s


def rollouts(robots: Sequence[RobotParameters], plans: Sequence[Plan]) -> list[list[Array]]:
    """Every robot drives every plan up to its last command.

    A command that is held for longer than SETTLED_S is driven that long; from there the robot goes
    on as it did last: on a steady circle.

    Returns:
        For each robot a path for each plan, x [m], y [m], yaw [rad], shape (steps + 1, 3).

    """
    steps = [step_count(plan.commands) for plan in plans]
    driven = [_driven_steps(plan, count) for plan, count in zip(plans, steps, strict=True)]
    result: list[list[Array]] = [[np.zeros(0)] * len(plans) for _ in robots]
    for length in sorted(set(driven)):
        chosen = [index for index, own in enumerate(driven) if own == length]
        volts = np.array(
            [
                wheel_volts(robot, plans[index].commands, plans[index].wheel_maps, length)
                for robot in robots
                for index in chosen
            ]
        )
        paths = simulate_paths([robot for robot in robots for _ in chosen], volts)
        for row, path in enumerate(paths):
            robot, index = row // len(chosen), chosen[row % len(chosen)]
            result[robot][index] = _carried_on(path, steps[index])
    return result


def _driven_steps(plan: Plan, steps: int) -> int:
    last_change_s = float(_since(plan.commands)[-2])
    return min(steps, round((last_change_s + SETTLED_S) / TIMESTEP_S))


def _carried_on(path: Array, steps: int) -> Array:
    """A path continued on the circle of its last STEADY_S."""
    missing = steps + 1 - len(path)
    if missing <= 0:
        return path
    period = round(STEADY_S / TIMESTEP_S)
    turn = path[-1, 2] - path[-1 - period, 2]
    step = (path[-1, :2] - path[-1 - period, :2]) @ (1, 1j)
    periods = np.arange(1, -(-missing // period) + 1)
    # Each period is the last one, turned and moved on.
    moved = step * np.exp(1j * turn * periods)
    base = path[-1, 0] + 1j * path[-1, 1] + np.concatenate([[0], np.cumsum(moved[:-1])])
    last = (path[-period:, 0] + 1j * path[-period:, 1]) - (path[-1 - period, :2] @ (1, 1j))
    points = (base[:, None] + np.exp(1j * turn * periods)[:, None] * last).ravel()[:missing]
    yaws = (path[-period:, 2] + (turn * periods)[:, None]).ravel()[:missing]
    return np.concatenate([path, np.stack([points.real, points.imag, yaws], axis=1)])


def simulate_paths(robots: Sequence[RobotParameters], volts: Array) -> Array:
    """Drive many robots at once, on all cores, each from the origin.

    Args:
        robots: n of them.
        volts: of each in each step, left and right, shape (n, steps, 2).

    Returns:
        x [m], y [m] of the axle's centre and yaw [rad], which counts whole turns, at the
        beginning of each step and at the end; shape (n, steps + 1, 3).

    """
    models: dict[RobotParameters, MjModel] = {}
    for robot in robots:
        if robot not in models:
            models[robot] = bare_model(robot)
    count, steps, _ = volts.shape
    batch_class: Any = importlib.import_module("mujoco.batch").Batch
    batch = batch_class(models[robots[0]], count, min(count, os.cpu_count() or 1))
    batch.set_models([models[robot] for robot in robots])
    batch.reset()
    controls = np.zeros((count, steps, models[robots[0]].nu))
    controls[..., :2] = volts  # the others are brakes, which take none
    standing = np.zeros((count, _SETTLING_STEPS, controls.shape[2]))
    batch.rollout(_SETTLING_STEPS, control=standing, control_spec=_CONTROL)
    begin = np.array(batch.bind("qpos")[:, None, :7])
    driven = batch.rollout(steps, control=controls, control_spec=_CONTROL)["qpos"][..., :7]
    joints = np.concatenate([begin, driven], axis=1)
    path = np.empty((count, steps + 1, 3))
    path[..., :2] = joints[..., :2] - begin[..., :2]
    w, x, y, z = np.moveaxis(joints[..., 3:7], -1, 0)
    path[..., 2] = np.unwrap(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)), axis=-1)
    return path


def bare_model(robot: RobotParameters) -> MjModel:
    """The robot on an endless floor, with nothing to see: compiled in half a millisecond."""
    spec = mujoco.MjSpec()
    spec.option.timestep = TIMESTEP_S
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    floor = "floor"
    spec.worldbody.add_geom(
        name=floor, type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], contype=0, conaffinity=0
    )
    add_robot(spec, robot)
    add_floor_contacts(spec, floor, robot)
    model = spec.compile()
    for flag in _UNNEEDED:
        model.opt.disableflags |= int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}"))
    return model


_CONTROL = int(mujoco.mjtState.mjSTATE_CTRL)
