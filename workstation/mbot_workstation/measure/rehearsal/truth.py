"""The robot to be found out: a calibration folder that is shown to nobody before the end.

It differs from the nominal robot about as far as a real one may: within the spreads that
`simulation/robot_parameters.py` gives, most of them near the end. A worn one has motors besides
that are beyond all of them.
"""

from pathlib import Path

import msgspec

from mbot_protocol.drive.calibration import CameraCalibration
from mbot_protocol.drive.picture import Picture
from mbot_workstation.pictures.picture_file import write_picture
from mbot_workstation.sim.body.robot_parameters import NOMINAL_BODIES
from mbot_workstation.sim.calibrated.body_calibration import (
    BodyCalibration,
    Component,
    MountCalibration,
    Weighing,
)
from mbot_workstation.sim.calibrated.calibration_folder import (
    ROOMS_FOLDER,
    CalibrationFiles,
    write_body,
    write_camera,
    write_light,
    write_motion,
)
from mbot_workstation.sim.calibrated.light_calibration import LightCalibration
from mbot_workstation.sim.calibrated.motion_calibration import MotionCalibration, MotorCalibration
from mbot_workstation.sim.scene.room_generator import generate_room

MADE_ON = "2026-11-21"

ROOM_SEED = 11

CAMERA = CameraCalibration(
    width_px=2028,
    height_px=1520,
    focal_x_px=1989.0,
    focal_y_px=1987.0,
    principal_x_px=1038.0,
    principal_y_px=741.0,
    distortion=(-0.085, 0.031, 0.0005, -0.0004, 0.0),
    reprojection_error_px=0.0,
    pictures=1,
    made_on=MADE_ON,
)

MOTION = MotionCalibration(
    left_motor=MotorCalibration(gain=1.05, dead_band=46.0, time_constant_ms=105.0),
    right_motor=MotorCalibration(gain=0.94, dead_band=57.0, time_constant_ms=118.0),
    free_speed_rpm=118.0,
    wheel_radius_m=0.0320,
    track_m=0.1175,
    wheel_friction=0.8,
    load_loss=0.03,
    latency_ms=38.0,
    made_on=MADE_ON,
)

WORN_MOTION = msgspec.structs.replace(
    MOTION,
    left_motor=MotorCalibration(
        gain=0.98, dead_band=52.0, time_constant_ms=150.0, backward_share=0.97
    ),
    right_motor=MotorCalibration(
        gain=0.52, dead_band=66.0, time_constant_ms=170.0, backward_share=0.94
    ),
    wheel_friction=0.6,
    load_loss=0.05,
    turning_drag_n_m=0.008,
)
"""One motor with about half the other's force, as in the paper's handicap, both slow and weaker
backward, and a caster that drags."""

LIGHT = LightCalibration(
    exposure_gain=0.84,
    red_gain=1.07,
    blue_gain=0.90,
    direction=(0.45, -0.5, -0.74),
    ambient=0.62,
    delta_e_before=0.0,
    delta_e_after=0.0,
    pictures=1,
    made_on=MADE_ON,
)

_MASSES_KG = {"chassis": 0.322, "battery pack": 0.251, "camera": 0.147, "mCore board": 0.043}

BODY = BodyCalibration(
    components=tuple(
        Component(
            name=body.name,
            mass_kg=_MASSES_KG.get(body.name, body.mass_kg),
            mass_uncertainty_kg=0.001,
            size_m=body.size_m,
            centre_m=body.centre_m,
            source="kitchen scale, ruler",
            centre_uncertainty_m=0.002,
            colour_rgb=body.colour_rgb,
        )
        for body in NOMINAL_BODIES
    ),
    camera_mount=MountCalibration(height_m=0.078, ahead_m=0.062, pitch_down_deg=6.5),
    wheel_mass_kg=0.037,
    weighings=(Weighing("whole robot", 0.977, 0.002),),
)

TRUTH = CalibrationFiles(camera=CAMERA, motion=MOTION, body=BODY, light=LIGHT)
WORN = msgspec.structs.replace(TRUTH, motion=WORN_MOTION)


def true_room() -> Picture:
    """The room it stands in. Shape (h, 2 h, 3), RGB."""
    return generate_room(ROOM_SEED)


def write_truth(folder: Path, motion: MotionCalibration = MOTION) -> None:
    """Write the folder that the virtual robot is made from.

    Args:
        folder: to write it to.
        motion: its motors; the rest of all robots here is the same.

    Raises:
        ConfigurationError: it can't be written.

    """
    write_body(folder, BODY)
    write_camera(folder, CAMERA)
    write_motion(folder, motion)
    write_light(folder, LIGHT)
    write_picture(folder / ROOMS_FOLDER / "room.png", true_room())


def corrected(motion: MotionCalibration, found: MotionCalibration) -> MotionCalibration:
    """True motors, driven by a daemon that corrects them by what was found."""
    left, right = (
        msgspec.structs.replace(
            true, trim=mine.trim, dead_band_compensation=mine.dead_band_compensation
        )
        for true, mine in (
            (motion.left_motor, found.left_motor),
            (motion.right_motor, found.right_motor),
        )
    )
    return msgspec.structs.replace(motion, left_motor=left, right_motor=right)
