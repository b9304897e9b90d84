"""Recorded commands driven by the simulated robot: where our own MuJoCo model goes with them.

The floor is bare and endless, since a run of 10 s leaves the task's arena; everything else is the
model of `simulation/`, step for step.
"""

import importlib
import os
from collections.abc import Sequence
from typing import Any

import numpy as np

from mbot_protocol.actions import WheelMaps, to_steps
from mbot_workstation.recordings.run import CommandSeries, Run
from mbot_workstation.recordings.track import Array, Track
from mbot_workstation.simulation.engine import MjModel, mujoco
from mbot_workstation.simulation.motor import duties, motor_voltage
from mbot_workstation.simulation.robot_mjcf import FLOOR_BIT, add_robot, resist_turning
from mbot_workstation.simulation.robot_parameters import RobotParameters
from mbot_workstation.simulation.timestep import TIMESTEP_S

STOPPING_S = 0.6
"""Simulated beyond the last command: any motor of up to 200 ms has stopped nearly by then."""

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
        origin, heading along +x. `run_view.RunView.end` gives what was measured in that frame.

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
        duties(wheel_maps.to_board(to_steps(left, right)))
        for left, right in zip(commands.left, commands.right, strict=True)
    ]
    motors = (robot.left_motor, robot.right_motor)
    volts = np.array(
        [
            [motor_voltage(d, m, robot.supply_v) for d, m in zip(row, motors, strict=True)]
            for row in rows
        ]
    )
    edges_s = commands.start_s + TIMESTEP_S * np.arange(steps + 1)
    held_s = np.diff(commands.time_s, append=max(edges_s[-1], commands.time_s[-1]) + 1)
    ends_s = np.append(commands.time_s, commands.time_s[-1] + held_s[-1])
    summed = np.vstack([np.zeros(2), np.cumsum(volts * held_s[:, None], axis=0)])
    upto = np.stack([np.interp(edges_s, ends_s, summed[:, side]) for side in (0, 1)], axis=1)
    return np.diff(upto, axis=0) / TIMESTEP_S


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
    standing = np.zeros((count, _SETTLING_STEPS, 2))
    batch.rollout(_SETTLING_STEPS, control=standing, control_spec=_CONTROL)
    begin = np.array(batch.bind("qpos")[:, None, :7])
    driven = batch.rollout(steps, control=volts, control_spec=_CONTROL)["qpos"][..., :7]
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
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], contype=FLOOR_BIT, conaffinity=0
    )
    add_robot(spec, robot)
    model = spec.compile()
    resist_turning(model, robot)
    for flag in _UNNEEDED:
        model.opt.disableflags |= int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}"))
    return model


_CONTROL = int(mujoco.mjtState.mjSTATE_CTRL)
