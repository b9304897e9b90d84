"""A robot's body as files: an example to fill in, and MJCF for other programs."""

import json
from pathlib import Path

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.sim.body.robot_mjcf import add_robot
from mbot_workstation.sim.body.robot_parameters import BoxBody, RobotParameters
from mbot_workstation.sim.engine import mujoco

NOMINAL_UNCERTAINTY = 0.2
"""Of an assumed mass, as a share."""

NOMINAL_PLACE_UNCERTAINTY_M = 0.005

HEADING = """\
# What this robot is made of: weighed with a kitchen scale, measured with a ruler.
#
#   workstation calibrate body components.toml
#
# checks it, draws it to scale and writes it into the calibration folder. Units are kilograms and
# metres throughout: 60 g is 0.060, 165 mm is 0.165. Axes: x points forward, y to the left, z up;
# x and y count from the middle between the wheels, z from the floor. Uncertainties are what you
# would say aloud as "plus or minus" and hardly ever be wrong with (95 %).
#
# These are the nominal robot's values, most of them assumed. Replace them by your own, add and
# remove components as you like; what is held by nothing else (screws, cables) goes to the part
# they are on.
"""

ROBOT_PART = """\
# One wheel with its tyre. Wheels are not components: they turn.
wheel_mass_kg = {wheel_mass_kg:g}
wheel_mass_uncertainty_kg = {wheel_mass_uncertainty_kg:g}
# Where the passive wheel touches the floor, ahead of the axle.
caster_ahead_m = {caster_ahead_m:g}
# By ruler. Better values come from driving, `workstation identify`, and then count more.
wheel_radius_m = {wheel_radius_m:g}
track_m = {track_m:g}
# The body as the task sees it: whatever comes nearer to the axle's centre than this is touched.
touch_radius_m = {touch_radius_m:g}
# Checks, all optional. What a scale below the caster shows, the wheels level beside it:
# caster_load_kg = 0.180

# Several parts on the scale at once; the single ones must add up to them. Without parts it is the
# whole robot with its wheels; "wheels" stands for both of them.
# [[weighings]]
# what = "whole robot"
# mass_kg = 0.940
# uncertainty_kg = 0.002
# [[weighings]]
# what = "camera with its plate"
# mass_kg = 0.150
# uncertainty_kg = 0.001
# parts = ["camera"]

# The camera's optical centre (in the middle of the lens) and where it looks: pitch down from the
# horizon, yaw to the left, roll clockwise as seen from behind.
[camera_mount]
height_m = {height_m:g}
ahead_m = {ahead_m:g}
left_m = {left_m:g}
pitch_down_deg = {pitch_down_deg:g}
yaw_left_deg = {yaw_left_deg:g}
roll_clockwise_deg = {roll_clockwise_deg:g}

# Every component is a box along the axes: size_m along x, y, z, centre_m the box's middle.
# source says where the figures are from; colour_rgb (0 to 1) is for the drawing and the simulation.
"""


def example_file() -> str:
    """The nominal robot as an annotated components file."""
    robot = RobotParameters()
    mount = robot.camera_mount
    names = ("caster_ahead_m", "wheel_radius_m", "track_m", "touch_radius_m", "wheel_mass_kg")
    parts = ROBOT_PART.format(
        **{name: getattr(robot, name) for name in names},
        wheel_mass_uncertainty_kg=robot.wheel_mass_kg * NOMINAL_UNCERTAINTY,
        **{name: getattr(mount, name) for name in mount.__slots__},
    )
    components = "\n".join(_component(body) for body in robot.bodies)
    return f"{HEADING}\n{parts}\n{components}"


def _component(body: BoxBody) -> str:
    return (
        "[[components]]\n"
        f"name = {json.dumps(body.name)}\n"
        f"mass_kg = {body.mass_kg:g}\n"
        f"mass_uncertainty_kg = {body.mass_kg * NOMINAL_UNCERTAINTY:g}\n"
        f"size_m = {_numbers(body.size_m)}\n"
        f"centre_m = {_numbers(body.centre_m)}\n"
        f"centre_uncertainty_m = {NOMINAL_PLACE_UNCERTAINTY_M:g}\n"
        'source = "size: public drawings; mass: assumed"\n'
        f"colour_rgb = {_numbers(body.colour_rgb)}\n"
    )


def _numbers(values: tuple[float, ...]) -> str:
    return f"[{', '.join(repr(float(value)) for value in values)}]"


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
