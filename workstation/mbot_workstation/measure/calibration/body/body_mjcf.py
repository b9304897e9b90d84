"""A robot's body as an MJCF file of its own, for other programs than this one."""

from pathlib import Path

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.sim.body.robot_mjcf import add_robot
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.engine import mujoco


def robot_mjcf(robot: RobotParameters) -> str:
    """The robot, its camera and its motors as XML; masses and inertias follow from its boxes."""
    spec = mujoco.MjSpec()
    spec.modelname = "mbot"
    add_robot(spec, robot)
    spec.compile()
    text: str = spec.to_xml()
    return text


def write_mjcf(robot: RobotParameters, path: Path) -> None:
    """Write it.

    Raises:
        ConfigurationError: it can't be written.

    """
    text = robot_mjcf(robot)
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ConfigurationError(f"can't write {path}: {error.strerror}") from None
