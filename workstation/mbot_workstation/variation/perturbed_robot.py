"""A robot with the effects put in: other numbers in the same parameters."""

import math
from dataclasses import replace

from mbot_protocol.actions import MotorMap, WheelMaps
from mbot_protocol.camera_model import CameraModel
from mbot_protocol.mcore import SPEED_LIMIT
from mbot_protocol.policy_contract import FULL_VIEW, OBSERVATION_SIDE_PX
from mbot_workstation.simulation.robot_parameters import (
    CameraMount,
    MotorParameters,
    RobotParameters,
)
from mbot_workstation.variation.effects import EffectRanges, RealWorldEffects


def perturbed_robot(robot: RobotParameters, effects: RealWorldEffects) -> RobotParameters:
    """The robot's body, motors and camera mount under these effects; its camera is left as it is.

    The effects' gains replace the robot's. Their dead band and time constant are the mean of both
    wheels, around which left and right differ as they do in the robot. The rest scales it.
    """
    scale = effects.mass_scale
    left, right = robot.left_motor, robot.right_motor
    dead_bands = shares(left.dead_band, right.dead_band)
    times = shares(left.time_constant_s, right.time_constant_s)
    return replace(
        robot,
        bodies=tuple(replace(body, mass_kg=body.mass_kg * scale) for body in robot.bodies),
        wheel_radius_m=robot.wheel_radius_m * effects.wheel_radius_scale,
        wheel_friction=robot.wheel_friction * effects.friction_scale,
        track_m=robot.track_m * effects.track_scale,
        free_speed_rpm=robot.free_speed_rpm * effects.speed_scale,
        left_motor=_motor(left, effects, effects.left_gain, dead_bands[0], times[0]),
        right_motor=_motor(right, effects, effects.right_gain, dead_bands[1], times[1]),
        camera_mount=_mount(robot.camera_mount, effects),
    )


def perturbed_wheel_maps(maps: WheelMaps, effects: RealWorldEffects) -> WheelMaps:
    """The daemon's motor maps under these effects: left and right differ as they do in `maps`."""
    left, right = shares(maps.left.dead_band, maps.right.dead_band)
    return WheelMaps(
        left=_motor_map(maps.left, effects.dead_band_compensation * left),
        right=_motor_map(maps.right, effects.dead_band_compensation * right),
    )


def trimmed(ranges: EffectRanges, maps: WheelMaps) -> EffectRanges:
    """The ranges with what the trims take away counted as weaker motors.

    For drivers that know a robot's effects but not its motor maps. Exact at full speed.
    """
    changed = ranges
    for name, wheel in (("left_gain", maps.left), ("right_gain", maps.right)):
        if wheel.trim < 1:
            dead_band = (ranges.low.dead_band + ranges.high.dead_band) / 2
            share = max(SPEED_LIMIT * wheel.trim - dead_band, 1.0) / (SPEED_LIMIT - dead_band)
            ends = getattr(ranges.low, name) * share, getattr(ranges.high, name) * share
            changed = changed.changed(**{name: ends})
    return changed


def shares(left: float, right: float) -> tuple[float, float]:
    """Both values in units of their mean."""
    mean = (left + right) / 2
    return (left / mean, right / mean) if mean > 0 else (1.0, 1.0)


def _motor(
    motor: MotorParameters,
    effects: RealWorldEffects,
    gain: float,
    dead_band_share: float,
    time_share: float,
) -> MotorParameters:
    return replace(
        motor,
        gain=gain,
        dead_band=effects.dead_band * dead_band_share / 255,
        time_constant_s=effects.time_constant_ms * time_share / 1000,
    )


def _motor_map(nominal: MotorMap, dead_band: float) -> MotorMap:
    most = math.ceil(SPEED_LIMIT * nominal.trim) - 1  # a motor map leaves some range for driving
    return replace(nominal, dead_band=min(round(dead_band), most))


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
    return replace(
        ideal,
        focal_x_px=ideal.focal_x_px / effects.fov_scale,
        focal_y_px=ideal.focal_y_px / effects.fov_scale,
        principal_x_px=ideal.principal_x_px + effects.principal_right * side,
        principal_y_px=ideal.principal_y_px + effects.principal_down * side,
        distortion=(effects.lens_k1, effects.lens_k2, 0.0, 0.0, 0.0),
    )
