"""Mass, centre of mass and inertia of a robot made of boxes and two wheels, with uncertainty."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.calibrated.body_calibration import BodyCalibration

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
    """Add the parts up.

    To first order, the parts' errors independent of each other; the wheels share theirs, since one
    is weighed for both.

    Args:
        body: the parts.
        robot: what they make, for the wheels.

    """
    parts = body.components
    wheel_kg, radius_m = robot.wheel_mass_kg, robot.wheel_radius_m
    wheels = [(0.0, side * robot.track_m / 2, radius_m) for side in (1, -1)]
    masses = np.array([*(part.mass_kg for part in parts), wheel_kg, wheel_kg])
    centres = np.array([*(part.centre_m for part in parts), *wheels])
    mass = float(masses.sum())
    centre = masses @ centres / mass

    mass_errors = np.array(
        [*(part.mass_uncertainty_kg for part in parts), 2 * body.wheel_mass_uncertainty_kg]
    )
    # A heavier part draws the centre towards itself; both wheels together towards the axle.
    arms = np.array([*(part.centre_m for part in parts), (0.0, 0.0, radius_m)]) - centre
    by_mass = mass_errors[:, None] * arms / mass
    place_errors = np.array([part.centre_uncertainty_m for part in parts])
    by_place = (masses[:-2] * place_errors / mass)[:, None] * np.ones(3)
    spread = np.sqrt((by_mass**2).sum(axis=0) + (by_place**2).sum(axis=0))

    inertia = np.zeros((3, 3))
    own = [_box_inertia(part.mass_kg, part.size_m) for part in parts]
    own += [np.eye(3) * 2 / 5 * wheel_kg * radius_m**2] * 2  # spheres, as they are simulated
    for part_mass, place, part_inertia in zip(masses, centres, own, strict=True):
        arm = place - centre
        inertia += part_inertia + part_mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return MassProperties(
        mass_kg=mass,
        mass_uncertainty_kg=float(np.sqrt((mass_errors**2).sum())),
        centre_m=centre,
        centre_uncertainty_m=spread,
        inertia_kg_m2=inertia,
    )


def _box_inertia(mass_kg: float, size_m: tuple[float, float, float]) -> Array:
    squares = np.square(size_m)
    return np.diag(mass_kg / 12 * (squares.sum() - squares))
