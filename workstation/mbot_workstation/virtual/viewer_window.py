"""A window with the simulation in MuJoCo's own viewer, to look at from all sides."""

import importlib
import os
import sys
import threading
from typing import Any

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.sim.engine import MjData, mujoco
from mbot_workstation.virtual.stand_in import VirtualRobot

REFRESH_S = 1 / 30


def check_display() -> None:
    """Refuse early where no window can open.

    Raises:
        ConfigurationError: there is no display.

    """
    displays = ("DISPLAY", "WAYLAND_DISPLAY")
    if sys.platform.startswith("linux") and not any(os.environ.get(name) for name in displays):
        raise ConfigurationError(
            "--view needs a display and DISPLAY is not set; leave it out, open the camera's URL "
            "in a browser, or use --record"
        )


def show(robot: VirtualRobot, stop: threading.Event) -> None:
    """Show the simulation until stopped, or until the window is closed, which sets `stop`."""
    viewer_module: Any = importlib.import_module("mujoco.viewer")
    model = robot.simulation.model
    # Data of its own: the viewer changes what it is given.
    data: MjData = mujoco.MjData(model)
    with viewer_module.launch_passive(model, data) as viewer:
        while not stop.wait(REFRESH_S) and viewer.is_running():
            state = robot.scene_state()
            with viewer.lock():
                data.qpos[:] = state.joints
                data.mocap_pos[:] = state.moved_pos
                data.mocap_quat[:] = state.moved_quat
                mujoco.mj_forward(model, data)
            viewer.sync()
    stop.set()
