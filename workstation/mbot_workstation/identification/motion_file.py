"""The result as motion.toml: the simulated robot's numbers, and the daemon's motor maps."""

import math
from datetime import date

from mbot_protocol.actions import MotorMap, WheelMaps
from mbot_protocol.calibration import Interval, MotionCalibration, MotorCalibration
from mbot_workstation.identification.estimate import Estimate, Identification
from mbot_workstation.simulation.robot_parameters import MotorParameters, RobotParameters

SAME_FOR_BOTH = "dry_friction"


def motion_calibration(found: Identification, recorded: WheelMaps) -> MotionCalibration:
    """What `write_motion` writes.

    Args:
        found: the result.
        recorded: the daemon's motor maps when it was recorded; their dead bands stay where the
            recordings can't tell the motors'.

    """
    robot = found.robot
    maps = straight_maps(found, recorded)
    intervals: dict[str, Interval] = {}
    undetermined: dict[str, str] = {}
    for one in (*found.estimates, found.latency):
        for key, factor in _keys(one.name):
            if one.low is not None and one.high is not None:
                intervals[key] = Interval(_short(factor * one.low), _short(factor * one.high))
            elif one.why_not is not None:
                undetermined[key] = one.why_not
    estimates = {one.name: one for one in found.estimates}
    return MotionCalibration(
        left_motor=_motor(robot.left_motor, maps.left),
        right_motor=_motor(robot.right_motor, maps.right),
        free_speed_rpm=_short(robot.free_speed_rpm),
        wheel_radius_m=_short(robot.wheel_radius_m),
        track_m=_short(robot.track_m),
        wheel_friction=_short(robot.wheel_friction),
        turning_drag_n_m=_short(robot.turning_drag_n_m),
        load_loss=_short(robot.load_loss),
        latency_ms=_short(1000 * found.latency.value),
        made_on=date.today().isoformat(),
        mass_ahead_m=_mass_ahead(robot, estimates["mass_ahead_m"]),
        inertia_scale=_short(robot.inertia_scale),
        intervals=intervals,
        undetermined=undetermined,
    )


def straight_maps(found: Identification, recorded: WheelMaps) -> WheelMaps:
    """Motor maps with which equal commands drive straight.

    The stronger motor is trimmed until both wheels roll at the same speed at full command. Where
    the dead bands are known, they are skipped, so that equal commands give equal speeds at every
    speed.
    """
    robot = found.robot
    weaker = min(robot.left_motor.gain, robot.right_motor.gain)
    determined = {one.name for one in found.estimates if one.low is not None}
    return WheelMaps(
        left=_map(robot.left_motor, weaker, recorded.left, known="left_dead_band" in determined),
        right=_map(
            robot.right_motor, weaker, recorded.right, known="right_dead_band" in determined
        ),
    )


def _map(motor: MotorParameters, gain: float, recorded: MotorMap, *, known: bool) -> MotorMap:
    working = gain / motor.gain
    trim = round(motor.dead_band + working * (1 - motor.dead_band), 3)
    skipped = math.floor(255 * motor.dead_band) if known else recorded.dead_band
    return MotorMap(recorded.reversed, min(trim, 1.0), skipped)


def _motor(motor: MotorParameters, used: MotorMap) -> MotorCalibration:
    return MotorCalibration(
        gain=_short(motor.gain),
        backward_share=_short(motor.backward_share),
        dead_band=_short(255 * motor.dead_band),
        time_constant_ms=_short(1000 * motor.time_constant_s),
        dry_friction=_short(motor.dry_friction),
        trim=used.trim,
        dead_band_compensation=used.dead_band,
    )


def _mass_ahead(robot: RobotParameters, estimate: Estimate) -> float | None:
    return None if estimate.low is None else _short(robot.centre_of_mass_m)


def _keys(name: str) -> list[tuple[str, float]]:
    """A parameter's keys in motion.toml, and the factor to its unit there."""
    side, _, field = name.partition("_")
    if name == SAME_FOR_BOTH:
        return [(f"{side}_motor.{name}", 1.0) for side in ("left", "right")]
    if side in {"left", "right"}:
        key, factor = {
            "gain": ("gain", 1.0),
            "backward_share": ("backward_share", 1.0),
            "dead_band": ("dead_band", 255.0),
            "time_constant_s": ("time_constant_ms", 1000.0),
        }[field]
        return [(f"{side}_motor.{key}", factor)]
    return [(name, 1000.0 if name == "latency_ms" else 1.0)]


def _short(number: float) -> float:
    """Six digits: more than any of it deserves."""
    return float(f"{number:.6g}")
