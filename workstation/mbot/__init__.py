"""A robot in a Python program: docs/python.md.

    from mbot import Robot

    with Robot("mbot-1") as robot:
        print(robot.state().state)
        robot.drive(0.4, -0.4, seconds=1)

`mbot.sim.make_env` is the simulation, for Gymnasium. Importing this loads neither that, nor torch
or MuJoCo.
"""

from mbot.beat import Beat, read_recording
from mbot.robot import Robot
from mbot.state import RobotState
from mbot_protocol.errors import (
    ConfigurationError,
    ContractError,
    MbotError,
    RefusedError,
    UnreachableError,
)

__all__ = [
    "Beat",
    "ConfigurationError",
    "ContractError",
    "MbotError",
    "RefusedError",
    "Robot",
    "RobotState",
    "UnreachableError",
    "read_recording",
]
