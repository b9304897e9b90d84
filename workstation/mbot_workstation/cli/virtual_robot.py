"""`workstation virtual-robot`: a robot without hardware, for the same daemon as on the Pi."""

import math
import os
from dataclasses import dataclass, fields, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.cli.common_options import (
    calibration_option,
    object_option,
    task_option,
)
from mbot_workstation.cli.options import option, output_file, with_options

if TYPE_CHECKING:
    from mbot_protocol.drive.camera_model import CameraModel
    from mbot_workstation.sim.body.robot_parameters import RobotParameters
    from mbot_workstation.sim.calibrated.calibration_folder import CalibrationFiles
    from mbot_workstation.sim.effects.effects import RealWorldEffects
    from mbot_workstation.sim.scene.scene_look import SceneLook
    from mbot_workstation.sim.scene.scene_parameters import SceneParameters
    from mbot_workstation.tasks.lesson import Lesson
    from mbot_workstation.virtual.camera_stream import CameraSettings
    from mbot_workstation.virtual.replay_session import ReplaySettings
    from mbot_workstation.virtual.stand_in import VirtualRobotSettings
    from mbot_workstation.virtual.virtual_session import Outputs

_TASK, _ROBOT, _CAMERA = "Task", "Robot", "Camera"
_OUTPUT = "What is left of it"

FREE_FLOOR_M = 100.0
"""Where walls and border stand with --free-floor: four minutes straight ahead."""

_WITH_REPLAY = {
    "replay", "board", "camera_port", "boot_seconds", "seconds", "calibration", "size",
    "frame_rate", "as_json", "write_config", "ready_file",
}  # fmt: skip


class CameraKind(StrEnum):
    """How its camera sees light."""

    FIXED = "fixed"
    PI = "pi"


class ArenaKind(StrEnum):
    """What the arena looks like."""

    NOMINAL = "nominal"
    ANY = "any"
    HOME = "home"


@dataclass(frozen=True, slots=True, kw_only=True)
class VirtualRobotOptions:
    """What `virtual_robot` takes."""

    panorama: Path | None = option(
        None,
        "360-degree photo of a room (equirectangular PNG or JPEG, twice as wide as high); "
        "a made-up room if not given.",
        metavar="FILE",
    )
    board: Path | None = option(
        None,
        "Where to put a symbolic link to the board's serial port. If not given, "
        "mbot-virtual-board in $XDG_RUNTIME_DIR or else in /tmp.",
        metavar="PATH",
    )
    camera_port: int = option(
        8090, "Camera's TCP port; 0: any free one.", metavar="PORT", min=0, max=65535
    )
    seconds: float = option(0.0, "End after so long; 0: run until Ctrl-C.", min=0)
    seed: int = option(0, "Of the room, the objects and the noise.")
    task: str = task_option(_TASK)
    radius: float | None = option(
        None,
        "How far from the middle objects appear, 0.45 to 2.8; 1.2 if not given. The paper's last "
        "lesson is 2.5.",
        panel=_TASK,
        metavar="METRES",
    )
    objects: int | None = option(
        None, "End after so many objects; no end if not given, or 0.", panel=_TASK, min=0
    )
    end_on_failure: bool = option(
        False,
        "End at the border or when an object's 66.8 s are up, as training does, instead "
        "of going on from the middle.",
        "--end-on-failure",
        panel=_TASK,
    )
    free_floor: bool = option(
        False,
        "No object, no border, no time limit: for driving maneuvers. A robot that has "
        "stood for 1.5 s is carried back to the middle.",
        "--free-floor",
        panel=_TASK,
    )
    replay: Path | None = option(
        None,
        "Nothing is simulated: its camera shows what this recording's robot saw, round and "
        "round, and its board goes nowhere. Takes --board, --camera-port, --boot-seconds, "
        "--seconds, --calibration, --size, --frame-rate, --json, --write-config, --ready-file.",
        "--replay",
        panel=_CAMERA,
        metavar="RECORDING",
    )
    arena: ArenaKind = option(
        ArenaKind.NOMINAL,
        "any: floor, boards, light and object as --seed draws them. home: things stand about "
        "besides, many of the object's colour; running into one costs.",
        panel=_TASK,
    )
    calibration: Path | None = calibration_option()
    object: Path | None = object_option(
        "What there is to fetch in place of the red cube, or a policy (.onnx) that was trained for "
        "it."
    )
    left_gain: float | None = option(
        None,
        "Left motor's strength; the calibration's, or else 1, if not given.",
        panel=_ROBOT,
        min=0.05,
        max=2,
    )
    right_gain: float | None = option(
        None, "Right motor's, likewise; 0.5 is the paper's handicap.", panel=_ROBOT, min=0.05, max=2
    )
    dead_band: float | None = option(
        None,
        "Speed of 255 up to which the wheels do not turn; 50 without a calibration.",
        panel=_ROBOT,
        min=0,
        max=250,
    )
    time_constant_ms: float | None = option(
        None, "Of a wheel's speed; 90 without a calibration.", panel=_ROBOT, min=5, max=2000
    )
    firmware: str | None = option(
        None,
        "Emulate the board's processor with this firmware on it (.elf, .hex), such as the "
        "stock one; `deadman` is ours. Needs gcc and simavr.",
        panel=_ROBOT,
        metavar="deadman|FILE",
    )
    table: str | None = option(
        None,
        "It stands on the middle of a table, as its infrared pairs feel; pictures show a floor all "
        "the same. Needs --firmware.",
        panel=_ROBOT,
        metavar="1.2x0.8",
    )
    boot_seconds: float = option(
        0.0,
        "A real board resets when its port is opened and is deaf for about 3 s; so does "
        "this one if above 0. With --firmware: the boot loader's part of it.",
        panel=_ROBOT,
        min=0,
        max=60,
    )
    frame_rate: float = option(30.0, "", panel=_CAMERA, metavar="HZ", min=1, max=120)
    size: str | None = option(
        None,
        "In pixels; 320 wide and of the camera's shape, 320x240, if not given; 640 with --replay.",
        panel=_CAMERA,
        metavar="WIDTHxHEIGHT",
    )
    camera_latency_ms: float = option(
        60.0, "From exposure to delivery.", panel=_CAMERA, min=0, max=1000
    )
    exposure_ms: float = option(
        20.0,
        "Blurs turns; 0: frozen. About what a camera has indoors.",
        panel=_CAMERA,
        min=0,
        max=100,
    )
    readout_ms: float = option(
        23.0, "From the first row to the last, which shears turns.", panel=_CAMERA, min=0, max=100
    )
    camera: CameraKind = option(
        CameraKind.FIXED,
        "fixed: exposure and white balance as calibrated. pi: both automatic, with a contrasty "
        "tone curve and sharpening, as a Raspberry Pi's camera has them.",
        panel=_CAMERA,
    )
    distortion: tuple[float, float] | None = option(
        None,
        "Of the lens, as OpenCV counts it; none without a calibration.",
        panel=_CAMERA,
        metavar="K1 K2",
    )
    plain: bool = option(
        False,
        "Draw without shadows and reflections, as training does; a sixth of the work.",
        "--plain",
        panel=_CAMERA,
    )
    result: Path | None = output_file(
        None, "The run in figures.", panel=_OUTPUT, metavar="FILE.json"
    )
    trajectory: Path | None = output_file(
        None,
        "Ten lines a second: time, robot, object; and what happened.",
        panel=_OUTPUT,
        metavar="FILE.jsonl",
    )
    truth_track: Path | None = output_file(
        None,
        "90 times a second where it truly is, as a tracker on it would write it: .csv is "
        "triad_openvr's format, .tum is TUM's. See docs/recordings.md.",
        panel=_OUTPUT,
        metavar="FILE",
    )
    truth_noise: tuple[float, float] = option(
        (4.0, 0.3),
        "Standard deviations of the truth track's noise.",
        panel=_OUTPUT,
        metavar="MM DEGREES",
    )
    truth_offset: tuple[float, float] = option(
        (0.0, 0.0),
        "Where the truth track's tracker sits, from the middle of the axle.",
        panel=_OUTPUT,
        metavar="AHEAD_MM LEFT_MM",
    )
    record: Path | None = output_file(
        None,
        "Film of what it sees, next to the arena from above.",
        panel=_OUTPUT,
        metavar="FILE.mp4",
    )
    view: bool = option(False, "Open a window.", "--view", panel=_OUTPUT)
    as_json: bool = option(False, "Print JSON, an object a line.", "--json", panel=_OUTPUT)
    write_config: Path | None = output_file(
        None,
        "A configuration for a daemon that is to drive it; kept if it is there and fits.",
        panel=_OUTPUT,
        metavar="robot.toml",
    )
    ready_file: Path | None = output_file(
        None,
        "Exists while camera and board are up, and says where they are.",
        panel=_OUTPUT,
        metavar="FILE.json",
    )


@with_options
def virtual_robot(options: VirtualRobotOptions) -> None:
    """Be a robot: a camera, http://127.0.0.1:8090/stream.mjpg, and an mCore board on a serial port.

    A red cube lies in the arena, or your --object; whoever drives the robot there scores, and it
    moves on.
    Point an mbot-agent at both, and it drives as on the Pi.

    Examples:

    - `workstation virtual-robot --write-config robot.toml` runs until Ctrl-C
    - `workstation virtual-robot --panorama my-room.jpg --radius 2.5 --objects 10 --result run.json`
    - `workstation virtual-robot --calibration calibration/mbot-1`
    - `workstation virtual-robot --object models/objects/green-ball.toml`
    - `workstation virtual-robot --arena home --seed 3` with things that are not the cube
    - `workstation virtual-robot --right-gain 0.5 --record handicap.mp4 --seconds 60`
    - `workstation virtual-robot --firmware stock.hex` has a board with the real firmware
    - `workstation virtual-robot --firmware deadman --table 1.2x0.8` may fall off
    - `workstation virtual-robot --replay drives/mbot-1/drive-0012-20261122-171501`
    """
    from mbot_workstation.cli.stop_signals import stop_signals
    from mbot_workstation.sim.calibrated.calibration_folder import files_to_simulate
    from mbot_workstation.virtual.live_report import LiveReport
    from mbot_workstation.virtual.replay_session import play
    from mbot_workstation.virtual.virtual_session import run_session

    files = files_to_simulate(options.calibration)
    report = LiveReport(as_json=options.as_json)
    if options.replay is not None:
        played = replay_settings(options, options.replay, files.robot.camera)
        with stop_signals() as stop:
            play(played, report, stop, options.seconds)
        return
    settings, left = robot_settings(options, files), outputs(options)
    with stop_signals() as stop:
        run_session(settings, left, report, stop, options.seconds)


def replay_settings(
    options: VirtualRobotOptions, recording: Path, camera: "CameraModel"
) -> "ReplaySettings":
    """What a recording is played back with.

    Raises:
        MbotError: the recording cannot be read, or an option means nothing with it.

    """
    from mbot_protocol.beat.recorded_drive import read_drive
    from mbot_workstation.virtual.replay_session import ReplaySettings

    usual = VirtualRobotOptions()
    for one in fields(options):
        if one.name not in _WITH_REPLAY and getattr(options, one.name) != getattr(usual, one.name):
            name = one.name.replace("_", "-")
            raise ConfigurationError(
                f"--{name} does nothing with --replay, which simulates nothing: leave it out"
            )
    width_px, height_px = _size(options.size, camera, 640)
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


def robot_settings(
    options: VirtualRobotOptions, files: "CalibrationFiles"
) -> "VirtualRobotSettings":
    """What a simulated robot is.

    Raises:
        MbotError: an option is out of range, or a file it names cannot be read.

    """
    from mbot_workstation.fleet.firmware.firmware_file import find_firmware
    from mbot_workstation.fleet.models.trained_object import objects_of
    from mbot_workstation.sim.calibrated.calibration_folder import room_pictures
    from mbot_workstation.sim.scene.room import load_room
    from mbot_workstation.sim.scene.room_generator import generate_room
    from mbot_workstation.tasks.find import full_reference
    from mbot_workstation.virtual.stand_in import VirtualRobotSettings

    robot = _robot(files.robot, options)
    scene = replace(files.scene, objects=objects_of(options.object))
    if options.free_floor:  # its walls beyond any maneuver's reach
        arena = replace(scene.arena, wall_m=FREE_FLOOR_M, border_m=FREE_FLOOR_M)
        scene = replace(scene, arena=arena)
    rooms = room_pictures(options.calibration) if options.calibration else ()
    panorama = options.panorama or (rooms[0] if rooms else None)
    return VirtualRobotSettings(
        robot=robot,
        scene=scene,
        look=_look(options, scene),
        room_picture=load_room(panorama) if panorama else generate_room(options.seed),
        task=full_reference(options.task),
        lesson=_lesson(options, scene, robot),
        camera=_camera(options, robot.camera, files.effects),
        camera_port=options.camera_port,
        board_link=options.board or _default_board(),
        boot_s=options.boot_seconds,
        firmware=find_firmware(options.firmware) if options.firmware else None,
        latency_s=files.motion.latency_ms / 1000 if files.motion else 0.0,
        seed=options.seed,
        free_floor=options.free_floor,
        table_m=_table(options.table, options.firmware),
    )


def _table(asked: str | None, firmware: str | None) -> tuple[float, float] | None:
    """A table's width and depth in metres."""
    if asked is None:
        return None
    if firmware is None:
        raise ConfigurationError("--table: a modelled board feels nothing; add --firmware deadman")
    try:
        width_m, depth_m = map(float, asked.lower().split("x"))
    except ValueError:
        width_m = depth_m = 0.0
    if not (0.3 <= width_m <= 20 and 0.3 <= depth_m <= 20):
        raise ConfigurationError(
            f"--table is {asked!r}, expected width x depth in metres, 0.3 to 20, such as 1.2x0.8"
        )
    return width_m, depth_m


def _look(options: VirtualRobotOptions, scene: "SceneParameters") -> "SceneLook | None":
    """The arena's look, if it is not the nominal one."""
    import numpy as np

    from mbot_workstation.sim.effects.home_looks import draw_home
    from mbot_workstation.sim.effects.scene_looks import draw_look

    if options.arena is ArenaKind.NOMINAL:
        return None
    draw = draw_home if options.arena is ArenaKind.HOME else draw_look
    return draw(np.random.default_rng(options.seed), scene.objects)


def _lesson(
    options: VirtualRobotOptions, scene: "SceneParameters", robot: "RobotParameters"
) -> "Lesson":
    """The task as the options have it; refused if nothing can be placed so."""
    import numpy as np

    from mbot_workstation.tasks.episode import Setting
    from mbot_workstation.tasks.find import find_task

    task = find_task(options.task)
    scene = task.scene(scene)
    footprints = tuple(thing.footprint for thing in scene.objects)
    setting = Setting(robot.touch_radius_m, scene.arena.border_m, footprints)
    try:
        lesson = task.play(options.radius, options.objects, ends_on_failure=options.end_on_failure)
        task.begin(lesson, setting, np.random.default_rng(options.seed))
    except ValueError as error:
        asked = {"--radius": options.radius, "--objects": options.objects}
        given = ", ".join(name for name, value in asked.items() if value is not None)
        raise ConfigurationError(f"{given or '--task'}: {error}") from None
    return lesson


def _robot(nominal: "RobotParameters", options: VirtualRobotOptions) -> "RobotParameters":
    """The robot, with what the options change about it."""
    from msgspec import structs

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


def _camera(
    options: VirtualRobotOptions, camera: "CameraModel", effects: "RealWorldEffects"
) -> "CameraSettings":
    from mbot_workstation.sim.camera.camera_renderer import Shutter
    from mbot_workstation.sim.camera.scene_renderer import SHOW, TRAINING
    from mbot_workstation.sim.effects.isp_settings import isp_settings
    from mbot_workstation.sim.effects.presets import PI_CAMERA
    from mbot_workstation.virtual.camera_stream import CameraSettings

    automatic = options.camera is CameraKind.PI
    isp = isp_settings(PI_CAMERA.low if automatic else effects)
    width_px, height_px = _size(options.size, camera, 320)
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


def _size(text: str | None, camera: "CameraModel", usual_width_px: int) -> tuple[int, int]:
    """Width and height as given, or the camera's shape at the usual width."""
    if text is None:
        height_px = round(usual_width_px * camera.height_px / camera.width_px)
        return usual_width_px, max(16, height_px)
    width, separator, height = text.lower().partition("x")
    if separator and width.isdecimal() and height.isdecimal():
        size = int(width), int(height)
        if min(size) >= 16 and max(size) <= 4056:
            return size
    raise ConfigurationError(
        f"--size is {text!r}, expected WIDTHxHEIGHT in pixels, 16 to 4056, such as 320x240"
    )


def _default_board() -> Path:
    return Path(os.environ.get("XDG_RUNTIME_DIR") or "/tmp") / "mbot-virtual-board"


def outputs(options: VirtualRobotOptions) -> "Outputs":
    """What a session leaves behind; raises ConfigurationError for noise out of range."""
    from mbot_workstation.virtual.truth_track import TrackerSettings
    from mbot_workstation.virtual.virtual_session import Outputs

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
