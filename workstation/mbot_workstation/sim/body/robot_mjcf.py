"""The robot as part of a MuJoCo model: boxes for the mass, two sphere wheels, caster, motors.

Spheres matched the paper's real robot best of the wheel shapes it tried; they touch the floor in
one point, which makes the wheel radius and the track exact. Axes: x forward, y left, z up, the
origin on the floor under the axle's centre.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbot_protocol.drive.camera_model import CameraModel
from mbot_workstation.sim.body.motor import ROTOR_INERTIA_KG_M2, motor_constants
from mbot_workstation.sim.body.robot_parameters import CameraMount, RobotParameters
from mbot_workstation.sim.camera.lens_distortion import covering_pinhole
from mbot_workstation.sim.engine import MjModel, MjSpec, mujoco

ROBOT = "robot"
ROBOT_CAMERA = "robot camera"
WHEELS = ("left wheel", "right wheel")

_PART = "part "
"""Before the names of bodies: somebody may call one "caster"."""

WALL_BIT = 1
"""Collision class of the walls, which the bumper meets."""

SLIDERS = ("caster", "tail")
ON_FLOOR = (*SLIDERS, *WHEELS)
"""What meets the floor. Told to MuJoCo pair by pair: with classes it looks through all shapes of
the scene for it at every step, an eighth of its time, for bit for bit the same drives (measured).
"""

HIDDEN_GROUP = 4
"""Of shapes and sites: MuJoCo draws groups 0 to 2 unless told otherwise, and takes time for what is
out of the picture too."""

BUMPER_CENTRE_HEIGHT_M = 0.10
"""Half a wall's height: the bumper is a sphere that reaches neither the floor nor over a wall."""

ROLLING_KNEE_M_S = 0.01
"""From which speed on rolling drag is at its limit: it is dry, but the simulation takes steps."""

CASTER_RADIUS_M = 0.010
TAIL_BEHIND_M, TAIL_CLEARANCE_M = 0.050, 0.0005
"""The rear end of the chassis, which touches the floor when a full reversal lifts the nose;
assumed. Without it such a robot would turn over backwards."""


def add_robot(spec: MjSpec, robot: RobotParameters) -> None:
    """Add the robot, its camera and its motors, which take volts, to the model."""
    base = spec.worldbody.add_body(name=ROBOT)
    base.add_freejoint(name=ROBOT)
    for part in robot.bodies:
        base.add_geom(
            name=f"{_PART}{part.name}",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=[edge / 2 for edge in part.size_m],
            pos=part.centre_m,
            mass=part.mass_kg,
            rgba=[*part.colour_rgb, 1],
            contype=0,
            conaffinity=0,
        )
    if robot.mass_ahead_m is not None or robot.inertia_scale != 1:
        _move_mass(base, robot)
    caster, tail = SLIDERS
    _add_slider(base, caster, robot.caster_ahead_m, 0.0)
    _add_slider(base, tail, -TAIL_BEHIND_M, TAIL_CLEARANCE_M)
    base.add_geom(
        name="bumper",
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        size=[robot.touch_radius_m, 0, 0],
        pos=[0, 0, BUMPER_CENTRE_HEIGHT_M],
        mass=0,
        condim=1,
        contype=0,
        conaffinity=WALL_BIT,
        group=HIDDEN_GROUP,
    )
    pinhole = covering_pinhole(robot.camera)
    base.add_camera(
        name=ROBOT_CAMERA,
        resolution=[pinhole.width_px, pinhole.height_px],
        # Any length will do for the sensor: the other two are given in pixels of it.
        sensor_size=[pinhole.width_px * 1e-6, pinhole.height_px * 1e-6],
        focal_pixel=[pinhole.focal_x_px, pinhole.focal_y_px],
        principal_pixel=[
            (pinhole.width_px - 1) / 2 - pinhole.principal_x_px,
            (pinhole.height_px - 1) / 2 - pinhole.principal_y_px,
        ],
        pos=[robot.camera_mount.ahead_m, robot.camera_mount.left_m, robot.camera_mount.height_m],
        quat=camera_quaternion(robot.camera_mount),
    )
    _add_wheel(spec, base, robot, 0)
    _add_wheel(spec, base, robot, 1)
    _add_drag(spec, base, robot)


def add_floor_contacts(spec: MjSpec, floor: str, robot: RobotParameters) -> None:
    """Let the robot that was added stand on a floor, the shape of this name."""
    frictions = floor_frictions(robot)
    for name in ON_FLOOR:
        pair = spec.add_pair(name=name, geomname1=floor, geomname2=name)
        pair.friction = frictions[name]
        pair.condim = 1 if name in SLIDERS else 3


def floor_frictions(robot: RobotParameters) -> dict[str, tuple[float, ...]]:
    """Friction of what is on the floor: sliding both ways, twisting, rolling both ways.

    None for what slides: MuJoCo's soft contacts lift whatever slides with friction, and the robot
    would bounce. What a caster costs in speed is `load_loss`, at the wheels.
    """
    grip = robot.wheel_friction
    return {
        name: (0.0,) * 5 if name in SLIDERS else (grip, grip, 0.0, 0.0, 0.0) for name in ON_FLOOR
    }


def _move_mass(base: Any, robot: RobotParameters) -> None:
    """Give the body the mass properties that driving has shown; what is seen stays."""
    alone = mujoco.MjSpec()
    body = alone.worldbody.add_body()
    for part in robot.bodies:
        half = [edge / 2 for edge in part.size_m]
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX, size=half, pos=part.centre_m, mass=part.mass_kg
        )
    made = alone.compile()
    base.explicitinertial = True
    base.mass = made.body_mass[1]
    base.iquat = made.body_iquat[1]
    # All three alike, so that no flat body gets an impossible one.
    base.inertia = robot.inertia_scale * made.body_inertia[1]
    base.ipos = made.body_ipos[1]
    if robot.mass_ahead_m is not None:
        base.ipos[0] = robot.mass_ahead_m * robot.mass_kg / base.mass


def part_name(model: MjModel, geom: int) -> str:
    """Which of the robot's bodies a shape is; empty if none."""
    name: str = model.geom(geom).name
    return name.removeprefix(_PART) if name.startswith(_PART) else ""


def _add_drag(spec: MjSpec, base: Any, robot: RobotParameters) -> None:
    """What the floor does against sliding and turning: brakes that give way at a limit.

    Sliding friction by a contact would let the robot bounce: MuJoCo's soft contacts lift whatever
    slides with friction. Added after the motors, whose controls come first.
    """
    base.add_site(name="drag", pos=[0, 0, 0], group=HIDDEN_GROUP)
    for name, direction, limit, knee in (
        ("rolling drag", [1, 0, 0, 0, 0, 0], robot.rolling_drag_n, ROLLING_KNEE_M_S),
        ("turning drag", [0, 0, 0, 0, 0, 1], robot.turning_drag_n_m, robot.turning_knee_rad_s),
    ):
        brake = spec.add_actuator(name=name, target="drag", trntype=mujoco.mjtTrn.mjTRN_SITE)
        brake.gear = direction
        brake.gaintype, brake.biastype = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_AFFINE
        brake.gainprm[0], brake.biasprm[2] = 0, -limit / knee
        most = max(limit, 1e-12)  # MuJoCo refuses an empty range
        brake.forcelimited, brake.forcerange = True, [-most, most]


def _add_slider(base: Any, name: str, ahead_m: float, clearance_m: float) -> None:
    base.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        size=[CASTER_RADIUS_M, 0, 0],
        pos=[ahead_m, 0, CASTER_RADIUS_M + clearance_m],
        mass=0,
        contype=0,
        conaffinity=0,
        rgba=[0.7, 0.7, 0.7, 1],
    )


def _add_wheel(spec: MjSpec, base: Any, robot: RobotParameters, side: int) -> None:
    name = WHEELS[side]
    left_m = robot.track_m / 2 * (1, -1)[side]
    motor = (robot.left_motor, robot.right_motor)[side]
    constants = motor_constants(robot, motor)
    wheel = base.add_body(name=name, pos=[0, left_m, robot.wheel_radius_m])
    wheel.add_joint(
        name=name,
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=[0, 1, 0],  # a positive turn about y rolls towards +x
        armature=ROTOR_INERTIA_KG_M2,
        damping=robot.load_loss * constants.constant_v_s**2 / constants.resistance_ohm,
        frictionloss=motor.dry_friction
        * robot.supply_v
        * constants.constant_v_s
        / constants.resistance_ohm,
    )
    wheel.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        size=[robot.wheel_radius_m, 0, 0],
        mass=robot.wheel_mass_kg,
        contype=0,
        conaffinity=0,
        group=HIDDEN_GROUP,  # a sphere would look odd; a disc is drawn instead
    )
    wheel.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=[robot.wheel_radius_m, 0.009, 0],
        quat=[math.sqrt(0.5), math.sqrt(0.5), 0, 0],
        mass=0,
        contype=0,
        conaffinity=0,
        rgba=[0.1, 0.1, 0.1, 1],
    )
    actuator = spec.add_actuator(
        name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT, ctrlspec=0
    )
    actuator.set_to_dcmotor(
        motorconst=[constants.constant_v_s, constants.constant_v_s],
        resistance=constants.resistance_ohm,
    )


def camera_quaternion(mount: CameraMount) -> NDArray[np.float64]:
    """The camera's orientation on the robot.

    MuJoCo's cameras look along their -z with +x to the right and +y up.

    Returns:
        Shape (4,), w x y z.

    """
    level = np.array([0.5, 0.5, -0.5, -0.5])  # camera x -> -y (right), y -> z (up), -z -> x
    yaw = _turn((0, 0, 1), mount.yaw_left_deg)
    pitch = _turn((0, 1, 0), mount.pitch_down_deg)
    roll = _turn((1, 0, 0), mount.roll_clockwise_deg)
    result = np.empty(4)
    mujoco.mju_mulQuat(result, yaw, pitch)
    mujoco.mju_mulQuat(result, result.copy(), roll)
    mujoco.mju_mulQuat(result, result.copy(), level)
    return result


def _turn(axis: tuple[int, int, int], angle_deg: float) -> NDArray[np.float64]:
    half = math.radians(angle_deg) / 2
    return np.array([math.cos(half), *(math.sin(half) * a for a in axis)])


def aim_camera(model: MjModel, camera: CameraModel) -> None:
    """Give the robot's camera other intrinsics at the same size, without distortion."""
    # With Python's numbers: in a training this is done for every picture, and numpy takes longer.
    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, ROBOT_CAMERA)
    sensor_w, sensor_h = model.cam_sensorsize[index].tolist()
    drawn_w_px, drawn_h_px = model.cam_resolution[index].tolist()
    pixel_w, pixel_h = sensor_w / drawn_w_px, sensor_h / drawn_h_px
    scale_w, scale_h = drawn_w_px / camera.width_px, drawn_h_px / camera.height_px
    # MuJoCo counts to the left and up, from the middle.
    left_px = (camera.width_px - 1) / 2 - camera.principal_x_px
    up_px = (camera.height_px - 1) / 2 - camera.principal_y_px
    model.cam_intrinsic[index] = (
        camera.focal_x_px * scale_w * pixel_w,
        camera.focal_y_px * scale_h * pixel_h,
        left_px * scale_w * pixel_w,
        up_px * scale_h * pixel_h,
    )
