"""What a robot's body makes of its commands, as numbers that drivers may be told."""

import numpy as np

from mbot_protocol.drive.actions import LEVELS, MotorMap
from mbot_workstation.sim.body.robot_parameters import MotorParameters, RobotParameters
from mbot_workstation.sim.effects.effects import RealWorldEffects
from mbot_workstation.sim.effects.perturbed_robot import perturbed_robot

BODY = (
    "left_gain",
    "right_gain",
    "speed_scale",
    "wheel_radius_scale",
    "track_scale",
    "dead_band",
    "dead_band_compensation",
    "action_latency_ms",
    "action_jitter_ms",
    "time_constant_ms",
    "friction_scale",
    "camera_latency_ms",
)
"""Gains are those left by motor trims, scales of what the robot has; dead bands are board speeds of
255 and, as the time constant, the mean of both wheels."""

BODY_RECORD = np.dtype([(name, np.float32) for name in BODY])


def body_record(effects: RealWorldEffects, robot: RobotParameters) -> tuple[float, ...]:
    """One robot's BODY_RECORD.

    Args:
        effects: on it.
        robot: what the effects start from, with its daemon's motor maps.

    """
    body, maps = perturbed_robot(robot, effects), robot.wheel_maps
    left, right = body.left_motor, body.right_motor
    known = {
        "left_gain": _trimmed_gain(left, maps.left),
        "right_gain": _trimmed_gain(right, maps.right),
        "dead_band": LEVELS * (left.dead_band + right.dead_band) / 2,
        "dead_band_compensation": effects.compensation_scale
        * (maps.left.dead_band + maps.right.dead_band)
        / 2,
        "time_constant_ms": 1000 * (left.time_constant_s + right.time_constant_s) / 2,
    }
    return tuple(known[name] if name in known else getattr(effects, name) for name in BODY)


def _trimmed_gain(motor: MotorParameters, own: MotorMap) -> float:
    """What a trim takes away counts as a weaker motor. Exact at full speed."""
    if own.trim >= 1:
        return motor.gain
    dead_band = LEVELS * motor.dead_band
    return motor.gain * max(LEVELS * own.trim - dead_band, 1.0) / (LEVELS - dead_band)
