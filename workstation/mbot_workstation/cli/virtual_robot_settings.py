"""What the options of `workstation virtual-robot` mean."""

import math
import os
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
from msgspec import structs

from mbot_protocol.beat.recorded_drive import read_drive
from mbot_protocol.drive.camera_model import CameraModel
from mbot_protocol.errors import ConfigurationError
from mbot_workstation.cli.virtual_robot import CameraKind, VirtualRobotOptions
from mbot_workstation.fleet.firmware.firmware_file import find_firmware
from mbot_workstation.sim.body.robot_parameters import RobotParameters
from mbot_workstation.sim.calibrated.calibration_folder import CalibrationFiles, room_pictures
from mbot_workstation.sim.camera.camera_renderer import Shutter
from mbot_workstation.sim.camera.scene_renderer import SHOW, TRAINING
from mbot_workstation.sim.effects.effects import RealWorldEffects
from mbot_workstation.sim.effects.isp_settings import isp_settings
from mbot_workstation.sim.effects.presets import PI_CAMERA
from mbot_workstation.sim.scene.object_file import read_objects
from mbot_workstation.sim.scene.room import load_room
from mbot_workstation.sim.scene.room_generator import generate_room
from mbot_workstation.sim.scene.scene_parameters import SceneParameters
from mbot_workstation.tasks.episode import Setting
from mbot_workstation.tasks.find import find_task, full_reference
from mbot_workstation.tasks.lesson import Lesson
from mbot_workstation.virtual.camera_stream import CameraSettings
from mbot_workstation.virtual.replay_session import ReplaySettings
from mbot_workstation.virtual.stand_in import VirtualRobotSettings
from mbot_workstation.virtual.truth_track import TrackerSettings
from mbot_workstation.virtual.virtual_session import Outputs

FREE_FLOOR_M = 100.0
"""Where walls and border stand with --free-floor: four minutes straight ahead."""

_WITH_REPLAY = {
    "replay", "board", "camera_port", "boot_seconds", "seconds", "calibration", "size",
    "frame_rate", "as_json", "write_config", "ready_file",
}  # fmt: skip


def replay_settings(
    options: VirtualRobotOptions, recording: Path, camera: CameraModel
) -> ReplaySettings:
    """What a recording is played back with.

    Raises:
        MbotError: the recording cannot be read, or an option means nothing with it.

    """
    usual = VirtualRobotOptions()
    for one in fields(options):
        if one.name not in _WITH_REPLAY and getattr(options, one.name) != getattr(usual, one.name):
            name = one.name.replace("_", "-")
            raise ConfigurationError(
                f"--{name} does nothing with --replay, which simulates nothing: leave it out"
            )
    width_px, height_px = _size(options.size) if options.size else _default_size(camera, 640)
    return ReplaySettings(
        drive=read_drive(recording),
        camera=camera.scaled_to(width_px, height_px),
        frame_rate_hz=options.frame_rate,
        camera_port=options.camera_port,
        board_link=options.board or _default_board(),
        boot_s=options.boot_seconds,
        ready_file=options.ready_file,
        daemon_config=options.write_config,
    )


def robot_settings(options: VirtualRobotOptions, files: CalibrationFiles) -> VirtualRobotSettings:
    """What a simulated robot is.

    Raises:
        MbotError: an option is out of range, or a file it names cannot be read.

    """
    robot = _robot(files.robot, options)
    scene = replace(files.scene, objects=read_objects(options.object))
    rooms = room_pictures(options.calibration) if options.calibration else ()
    panorama = options.panorama or (rooms[0] if rooms else None)
    lesson = _lesson(options, scene, robot)
    return VirtualRobotSettings(
        robot=robot,
        scene=_free(scene) if options.free_floor else scene,
        room_picture=load_room(panorama) if panorama else generate_room(options.seed),
        task=full_reference(options.task),
        lesson=lesson,
        camera=_camera(options, robot.camera, files.effects),
        camera_port=options.camera_port,
        board_link=options.board or _default_board(),
        boot_s=options.boot_seconds,
        firmware=find_firmware(options.firmware) if options.firmware else None,
        latency_s=files.motion.latency_ms / 1000 if files.motion else 0.0,
        seed=options.seed,
        free_floor=options.free_floor,
    )


def _lesson(options: VirtualRobotOptions, scene: SceneParameters, robot: RobotParameters) -> Lesson:
    """The task as the options have it; refused if nothing can be placed so."""
    task = find_task(options.task)
    scene = task.scene(scene)
    setting = Setting(
        robot.touch_radius_m,
        scene.arena.border_m,
        tuple(thing.footprint for thing in scene.objects),
    )
    try:
        lesson = task.play(options.radius, options.objects, ends_on_failure=options.end_on_failure)
        task.begin(lesson, setting, np.random.default_rng(options.seed))
    except ValueError as error:
        raise ConfigurationError(f"--radius: {error}") from None
    return lesson


def _camera(
    options: VirtualRobotOptions, camera: CameraModel, effects: RealWorldEffects
) -> CameraSettings:

    automatic = options.camera is CameraKind.PI
    isp = isp_settings(PI_CAMERA.low if automatic else effects)
    width_px, height_px = _size(options.size) if options.size else _default_size(camera)
    return CameraSettings(
        width_px=width_px,
        height_px=height_px,
        frame_rate_hz=options.frame_rate,
        latency_s=options.camera_latency_ms / 1000,
        shutter=Shutter(options.exposure_ms / 1000, options.readout_ms / 1000),
        isp=replace(isp, jpeg_quality=100),  # the stream is JPEG by itself
        jpeg_quality=round(isp.jpeg_quality),
        quality=TRAINING if options.plain else SHOW,
        noise_seed=options.seed,
    )


def outputs(options: VirtualRobotOptions) -> Outputs:
    """What a session leaves behind; raises ConfigurationError for noise out of range."""
    noise_mm, noise_deg = options.truth_noise
    if not 0 <= noise_mm <= 100 or not 0 <= noise_deg <= 30:
        raise ConfigurationError(
            f"--truth-noise is {noise_mm:g} mm, {noise_deg:g} degrees, expected 0 to 100, 0 to 30"
        )
    tracker = TrackerSettings(
        position_noise_m=noise_mm / 1000,
        angle_noise_rad=math.radians(noise_deg),
        ahead_m=options.truth_offset[0] / 1000,
        left_m=options.truth_offset[1] / 1000,
        seed=options.seed,
    )
    return Outputs(
        result=options.result,
        trajectory=options.trajectory,
        film=options.record,
        truth_track=options.truth_track,
        tracker=tracker,
        ready_file=options.ready_file,
        daemon_config=options.write_config,
        view=options.view,
    )


def _size(text: str) -> tuple[int, int]:
    width, separator, height = text.lower().partition("x")
    if separator and width.isdecimal() and height.isdecimal():
        size = int(width), int(height)
        if min(size) >= 16 and max(size) <= 4056:
            return size
    raise ConfigurationError(
        f"--size is {text!r}, expected WIDTHxHEIGHT in pixels, 16 to 4056, such as 320x240"
    )


def _default_size(camera: CameraModel, width_px: int = 320) -> tuple[int, int]:
    """The camera's shape, by default at the size the daemon asks the Pi's camera for."""
    return width_px, max(16, round(width_px * camera.height_px / camera.width_px))


def _free(scene: SceneParameters) -> SceneParameters:
    """The scene with its walls beyond any maneuver's reach."""
    return replace(scene, arena=replace(scene.arena, wall_m=FREE_FLOOR_M, border_m=FREE_FLOOR_M))


def _default_board() -> Path:

    return Path(os.environ.get("XDG_RUNTIME_DIR") or "/tmp") / "mbot-virtual-board"


def _robot(nominal: RobotParameters, options: VirtualRobotOptions) -> RobotParameters:
    """The robot, with what the options change about it."""
    motors = [nominal.left_motor, nominal.right_motor]
    for side, gain in enumerate((options.left_gain, options.right_gain)):
        if gain is not None:
            motors[side] = replace(motors[side], gain=gain)
        if options.dead_band is not None:
            motors[side] = replace(motors[side], dead_band=options.dead_band / 255)
        if options.time_constant_ms is not None:
            motors[side] = replace(motors[side], time_constant_s=options.time_constant_ms / 1000)
    camera = nominal.camera
    if options.distortion is not None:
        camera = structs.replace(camera, distortion=(*options.distortion, 0.0, 0.0, 0.0))
    return replace(nominal, left_motor=motors[0], right_motor=motors[1], camera=camera)
