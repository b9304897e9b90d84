"""One calibrated robot that differs from the nominal one in everything."""

from mbot_protocol.drive.calibration import CameraCalibration
from mbot_workstation.sim.calibrated.body_calibration import (
    BodyCalibration,
    Component,
    MountCalibration,
    Weighing,
)
from mbot_workstation.sim.calibrated.light_calibration import LightCalibration
from mbot_workstation.sim.calibrated.motion_calibration import (
    Interval,
    MotionCalibration,
    MotorCalibration,
)

CAMERA = CameraCalibration(
    width_px=2028,
    height_px=1520,
    focal_x_px=1990.0,
    focal_y_px=1985.0,
    principal_x_px=1041.0,
    principal_y_px=745.0,
    distortion=(-0.12, 0.05, 0.0006, -0.0004, 0.01),
    reprojection_error_px=0.31,
    pictures=21,
    made_on="2026-11-21",
)

MOTION = MotionCalibration(
    left_motor=MotorCalibration(
        gain=1.06, dead_band=54.0, time_constant_ms=90.0, trim=0.9, dead_band_compensation=44
    ),
    right_motor=MotorCalibration(
        gain=0.94, dead_band=46.0, time_constant_ms=110.0, dead_band_compensation=36
    ),
    free_speed_rpm=118.0,
    wheel_radius_m=0.0319,
    track_m=0.117,
    wheel_friction=0.8,
    load_loss=0.03,
    latency_ms=35.0,
    made_on="2026-11-21",
    intervals={"left_motor.gain": Interval(1.05, 1.07)},
    undetermined={"free_speed_rpm": "scales with both gains"},
)

LIGHT = LightCalibration(
    exposure_gain=0.8,
    red_gain=1.1,
    blue_gain=0.9,
    direction=(-0.3, 0.6, -0.7),
    ambient=0.6,
    delta_e_before=12.0,
    delta_e_after=1.5,
    pictures=3,
    made_on="2026-11-21",
)

BODY = BodyCalibration(
    components=(
        Component("frame", 0.42, 0.002, (0.16, 0.08, 0.03), (0.02, 0.0, 0.045), "scale, ruler"),
        Component("battery", 0.25, 0.001, (0.1, 0.065, 0.022), (0.0, 0.0, 0.072), "scale, ruler"),
        Component("camera", 0.15, 0.001, (0.04, 0.04, 0.03), (0.04, 0.0, 0.1), "data sheet"),
    ),
    camera_mount=MountCalibration(height_m=0.1, ahead_m=0.062, pitch_down_deg=7.0),
    wheel_mass_kg=0.038,
    caster_ahead_m=0.07,
    touch_radius_m=0.095,
    weighings=(Weighing("whole robot", 0.9, 0.01),),
)
