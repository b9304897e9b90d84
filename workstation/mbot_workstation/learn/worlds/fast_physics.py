"""What training may leave out of a simulation without anybody noticing."""

from collections.abc import Sequence

import numpy as np

from mbot_protocol.drive.picture import Picture
from mbot_workstation.sim.body.robot_mjcf import HIDDEN_GROUP
from mbot_workstation.sim.engine import MjModel, mujoco
from mbot_workstation.sim.scene.floor_textures import FloorTexture

TRAINING_TIMESTEP_S = 0.010
"""Twice the simulation's. Against 1 ms, 300 random decisions between full backward and forward end
0.8 mm and 1.2 degrees away (median; at most 3.5 mm and 3.5 degrees; 5 ms: 0.4 mm, 0.5 degrees), as
if the wheels were 5 ms slower, which is a tenth of what is unknown about them; half the work."""

PLACEHOLDER: Picture = np.zeros((4, 8, 3), np.uint8)
"""The room of simulations that are drawn with another one's textures."""


def hasten(model: MjModel) -> None:
    """Make a simulation's model cheap to step."""
    model.opt.timestep = TRAINING_TIMESTEP_S
    # No sensors are there, and what finds pairs and islands costs more than it saves with five
    # shapes that can touch: together a fifth of a step, bit for bit the same result.
    for flag in ("SENSOR", "MIDPHASE", "ISLAND"):
        model.opt.disableflags |= int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}"))
    # An episode ends before the bumper can meet a wall: nothing is left that would meet by class.
    for classes in (model.geom_contype, model.body_contype, model.body_conaffinity):
        classes[:] = 0


def hide(model: MjModel, geoms: Sequence[int]) -> None:
    """Leave shapes undrawn that the robot's camera can't see; the robot's own cost a third more."""
    model.geom_group[list(geoms)] = HIDDEN_GROUP


def placeholders(floors: Sequence[FloorTexture]) -> list[FloorTexture]:
    """As many floors, for simulations that are drawn with another one's textures."""
    return [FloorTexture(PLACEHOLDER[:, :4], floor.side_m) for floor in floors]
