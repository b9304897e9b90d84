"""Mass, centre of mass and inertia of a robot made of boxes and two wheels, with uncertainty."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mbot_workstation.sim.body.robot_mjcf import ROBOT, add_robot
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.calibrated.body_calibration import BodyCalibration
from mbot_workstation.sim.engine import mujoco

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class MassProperties:
    """Of a whole robot. Uncertainties are half the width of a 95 % interval.

    Attributes:
        mass_kg, mass_uncertainty_kg: with both wheels.
        centre_m, centre_uncertainty_m: centre of mass, shapes (3,); x and y from the axle's
            centre, z from the floor.
        inertia_kg_m2: about the centre of mass, shape (3, 3).

    """

    mass_kg: float
    mass_uncertainty_kg: float
    centre_m: Array
    centre_uncertainty_m: Array
    inertia_kg_m2: Array


def mass_properties(body: BodyCalibration, robot: RobotParameters) -> MassProperties:
    """What MuJoCo makes of the parts, and how sure that is.

    Uncertainties are to first order, the parts' errors independent of each other; the wheels
    share theirs, since one is weighed for both.

    Args:
        body: the parts.
        robot: what they make.

    """
    # As weighed: what driving has found out about its mass is another file's.
    weighed = replace(
        RobotParameters(),
        bodies=robot.bodies,
        wheel_mass_kg=robot.wheel_mass_kg,
        wheel_radius_m=robot.wheel_radius_m,
        track_m=robot.track_m,
    )
    spec = mujoco.MjSpec()
    add_robot(spec, weighed)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    base = model.body(ROBOT).id
    mass, centre = float(model.body_subtreemass[base]), np.array(data.subtree_com[base])
    xx, yy, zz, xy, xz, yz = data.crb[base, :6]  # of all that hangs on it, about their centre

    parts = body.components
    mass_errors = np.array(
        [*(part.mass_uncertainty_kg for part in parts), 2 * body.wheel_mass_uncertainty_kg]
    )
    # A heavier part draws the centre towards itself; both wheels together towards the axle.
    arms = np.array([*(part.centre_m for part in parts), (0.0, 0.0, robot.wheel_radius_m)]) - centre
    by_mass = mass_errors[:, None] * arms / mass
    by_place = np.array([part.mass_kg * part.centre_uncertainty_m for part in parts]) / mass
    spread = np.sqrt((by_mass**2).sum(axis=0) + (by_place**2).sum())
    return MassProperties(
        mass_kg=mass,
        mass_uncertainty_kg=float(np.sqrt((mass_errors**2).sum())),
        centre_m=centre,
        centre_uncertainty_m=spread,
        inertia_kg_m2=np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]),
    )
