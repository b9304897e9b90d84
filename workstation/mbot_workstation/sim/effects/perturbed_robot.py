"""A robot with the effects put in: other numbers in the same parameters."""

import math
from dataclasses import replace

from msgspec import structs

from mbot_protocol.drive.actions import LEVELS, MotorMap, WheelMaps
from mbot_protocol.drive.camera_model import CameraModel
from mbot_protocol.policy.policy_contract import FULL_VIEW, OBSERVATION_SIDE_PX
from mbot_workstation.sim.body.parameter_table import BY_NAME
from mbot_workstation.sim.body.robot_parameters import (
    CameraMount,
    MotorParameters,
    RobotParameters,
)
from mbot_workstation.sim.effects.effects import RealWorldEffects

MOST_DEAD_BAND = BY_NAME["left_dead_band"].high
"""However much larger it becomes: a motor that never turns is no robot to drive."""


def perturbed_robot(robot: RobotParameters, effects: RealWorldEffects) -> RobotParameters:
    """The robot's body, motors and camera mount under these effects; its camera is left as it is.

    Scales multiply what the robot has, the mount is shifted.
    """
    scale = effects.mass_scale
    return replace(
        robot,
        bodies=tuple(replace(body, mass_kg=body.mass_kg * scale) for body in robot.bodies),
        wheel_radius_m=robot.wheel_radius_m * effects.wheel_radius_scale,
        wheel_friction=robot.wheel_friction * effects.friction_scale,
        track_m=robot.track_m * effects.track_scale,
        free_speed_rpm=robot.free_speed_rpm * effects.speed_scale,
        left_motor=_motor(robot.left_motor, effects, effects.left_gain),
        right_motor=_motor(robot.right_motor, effects, effects.right_gain),
        camera_mount=_mount(robot.camera_mount, effects),
    )


def perturbed_wheel_maps(maps: WheelMaps, effects: RealWorldEffects) -> WheelMaps:
    """The daemon's motor maps under these effects."""
    left, right = (_motor_map(one, effects.compensation_scale) for one in (maps.left, maps.right))
    return WheelMaps(left, right)


def _motor(motor: MotorParameters, effects: RealWorldEffects, gain: float) -> MotorParameters:
    return replace(
        motor,
        gain=motor.gain * gain,
        dead_band=min(motor.dead_band * effects.dead_band_scale, MOST_DEAD_BAND),
        time_constant_s=motor.time_constant_s * effects.time_constant_scale,
    )


def _motor_map(own: MotorMap, scale: float) -> MotorMap:
    most = math.ceil(LEVELS * own.trim) - 1  # a motor map leaves some range for driving
    return structs.replace(own, dead_band=min(round(own.dead_band * scale), most))


def _mount(mount: CameraMount, effects: RealWorldEffects) -> CameraMount:
    return replace(
        mount,
        height_m=mount.height_m + effects.camera_up_mm / 1000,
        pitch_down_deg=mount.pitch_down_deg + effects.camera_pitch_deg,
        yaw_left_deg=mount.yaw_left_deg + effects.camera_yaw_deg,
        roll_clockwise_deg=mount.roll_clockwise_deg + effects.camera_roll_deg,
    )


def observing_camera(effects: RealWorldEffects) -> CameraModel:
    """The camera as the observation's pixels see through it.

    `Observer` cuts the policy's view out of what it takes the camera for; the effects are the
    difference between that and the real camera. Without any, this is the policy's view itself.
    """
    side = OBSERVATION_SIDE_PX
    ideal = CameraModel.from_field_of_view(
        side, side, FULL_VIEW.horizontal_deg, FULL_VIEW.vertical_deg
    )
    return structs.replace(
        ideal,
        focal_x_px=ideal.focal_x_px / effects.fov_scale,
        focal_y_px=ideal.focal_y_px / effects.fov_scale,
        principal_x_px=ideal.principal_x_px + effects.principal_right * side,
        principal_y_px=ideal.principal_y_px + effects.principal_down * side,
        distortion=(effects.lens_k1, effects.lens_k2, 0.0, 0.0, 0.0),
    )
