"""`workstation virtual-robot`: a robot without hardware, for the same daemon as on the Pi."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.commands.calibration_option import CalibrationOption

if TYPE_CHECKING:
    from mbot_protocol.camera_model import CameraModel
    from mbot_workstation.simulation.robot_parameters import RobotParameters
    from mbot_workstation.simulation.scene_parameters import SceneParameters
    from mbot_workstation.variation.effects import RealWorldEffects

_TASK, _ROBOT, _CAMERA = "Task", "Robot", "Camera"
_OUTPUT = "What is left of it"

FREE_FLOOR_M = 100.0
"""Where walls and border stand with --free-floor: four minutes straight ahead."""


def virtual_robot(
    *,
    panorama: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="360-degree photo of a room (equirectangular PNG or JPEG, twice as wide as high); "
            "a made-up room if not given.",
        ),
    ] = None,
    board: Annotated[
        Path | None,
        typer.Option(
            metavar="PATH",
            help="Where to put a symbolic link to the board's serial port. If not given, "
            "mbot-virtual-board in $XDG_RUNTIME_DIR or else in /tmp.",
        ),
    ] = None,
    camera_port: Annotated[
        int,
        typer.Option(metavar="PORT", min=0, max=65535, help="Camera's TCP port; 0: any free one."),
    ] = 8090,
    seconds: Annotated[
        float, typer.Option(min=0, help="End after so long; 0: run until Ctrl-C.")
    ] = 0.0,
    seed: Annotated[int, typer.Option(help="Of the room, the objects and the noise.")] = 0,
    radius: Annotated[
        float,
        typer.Option(
            metavar="METRES",
            help="How far from the middle objects appear, 0.45 to 2.8; the paper's last lesson "
            "is 2.5.",
            rich_help_panel=_TASK,
        ),
    ] = 1.2,
    objects: Annotated[
        int,
        typer.Option(min=0, help="End after so many objects; 0: no end.", rich_help_panel=_TASK),
    ] = 0,
    end_on_failure: Annotated[
        bool,
        typer.Option(
            "--end-on-failure",
            help="End at the border or when an object's 66.8 s are up, as training does, instead "
            "of going on from the middle.",
            rich_help_panel=_TASK,
        ),
    ] = False,
    free_floor: Annotated[
        bool,
        typer.Option(
            "--free-floor",
            help="No object, no border, no time limit: for driving manoeuvres. A robot that has "
            "stood for 1.5 s is carried back to the middle.",
            rich_help_panel=_TASK,
        ),
    ] = False,
    calibration: CalibrationOption = None,
    left_gain: Annotated[
        float | None,
        typer.Option(
            min=0.05,
            max=2,
            help="Left motor's strength; the calibration's, or else 1, if not given.",
            rich_help_panel=_ROBOT,
        ),
    ] = None,
    right_gain: Annotated[
        float | None,
        typer.Option(
            min=0.05,
            max=2,
            help="Right motor's, likewise; 0.5 is the paper's handicap.",
            rich_help_panel=_ROBOT,
        ),
    ] = None,
    dead_band: Annotated[
        float | None,
        typer.Option(
            min=0,
            max=250,
            help="Speed of 255 up to which wheels stand; 50 without a calibration.",
            rich_help_panel=_ROBOT,
        ),
    ] = None,
    time_constant_ms: Annotated[
        float | None,
        typer.Option(
            min=5,
            max=2000,
            help="Of a wheel's speed; 90 without a calibration.",
            rich_help_panel=_ROBOT,
        ),
    ] = None,
    firmware: Annotated[
        str | None,
        typer.Option(
            metavar="deadman|FILE",
            help="Emulate the board's processor with this firmware on it (.elf, .hex), such as the "
            "stock one; `deadman` is ours. Needs gcc and simavr.",
            rich_help_panel=_ROBOT,
        ),
    ] = None,
    boot_seconds: Annotated[
        float,
        typer.Option(
            min=0,
            max=60,
            help="A real board resets when its port is opened and is deaf for about 3 s; so does "
            "this one if above 0. With --firmware: the boot loader's part of it.",
            rich_help_panel=_ROBOT,
        ),
    ] = 0.0,
    frame_rate: Annotated[
        float, typer.Option(metavar="HZ", min=1, max=120, rich_help_panel=_CAMERA)
    ] = 30.0,
    size: Annotated[
        str | None,
        typer.Option(
            metavar="WIDTHxHEIGHT",
            help="In pixels; 320 wide and of the camera's shape, 320x240, if not given.",
            rich_help_panel=_CAMERA,
        ),
    ] = None,
    camera_latency_ms: Annotated[
        float,
        typer.Option(min=0, max=1000, help="From exposure to delivery.", rich_help_panel=_CAMERA),
    ] = 60.0,
    exposure_ms: Annotated[
        float,
        typer.Option(
            min=0,
            max=100,
            help="Blurs motion; 0: frozen. A real camera indoors has about 20. Every one of "
            "--blur-pictures costs a whole picture: add --plain on a slow machine.",
            rich_help_panel=_CAMERA,
        ),
    ] = 0.0,
    blur_pictures: Annotated[
        int,
        typer.Option(min=2, max=16, help="Pictures in an exposure.", rich_help_panel=_CAMERA),
    ] = 4,
    distortion: Annotated[
        tuple[float, float] | None,
        typer.Option(
            metavar="K1 K2",
            help="Of the lens, as OpenCV counts it; none without a calibration.",
            rich_help_panel=_CAMERA,
        ),
    ] = None,
    plain: Annotated[
        bool,
        typer.Option(
            "--plain",
            help="Draw without shadows and reflections, as training does; a sixth of the work.",
            rich_help_panel=_CAMERA,
        ),
    ] = False,
    result: Annotated[
        Path | None,
        typer.Option(metavar="FILE.json", help="The run in figures.", rich_help_panel=_OUTPUT),
    ] = None,
    trajectory: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.jsonl",
            help="Ten lines a second: time, robot, object; and what happened.",
            rich_help_panel=_OUTPUT,
        ),
    ] = None,
    truth_track: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="90 times a second where it truly is, as a tracker on it would write it: .csv is "
            "triad_openvr's format, .tum is TUM's. See docs/recordings.md.",
            rich_help_panel=_OUTPUT,
        ),
    ] = None,
    truth_noise: Annotated[
        tuple[float, float],
        typer.Option(
            metavar="MM DEGREES",
            help="Standard deviations of the truth track's noise.",
            rich_help_panel=_OUTPUT,
        ),
    ] = (4.0, 0.3),
    truth_offset: Annotated[
        tuple[float, float],
        typer.Option(
            metavar="AHEAD_MM LEFT_MM",
            help="Where the truth track's tracker sits, from the middle of the axle.",
            rich_help_panel=_OUTPUT,
        ),
    ] = (0.0, 0.0),
    record: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.mp4",
            help="Film of what it sees, next to the arena from above.",
            rich_help_panel=_OUTPUT,
        ),
    ] = None,
    view: Annotated[
        bool, typer.Option("--view", help="Open a window.", rich_help_panel=_OUTPUT)
    ] = False,
    as_json: Annotated[
        bool,
        typer.Option("--json", help="Print JSON, an object a line.", rich_help_panel=_OUTPUT),
    ] = False,
    ready_file: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.json",
            help="Exists while camera and board are up, and says where they are.",
            rich_help_panel=_OUTPUT,
        ),
    ] = None,
) -> None:
    """Be a robot: a camera, http://127.0.0.1:8090/stream.mjpg, and an mCore board on a serial port.

    A red cube lies in the arena; whoever drives the robot there scores, and the cube moves on.
    Point an mbot-agent at both, and it drives as on the Pi.

    Examples:

    - `workstation virtual-robot` runs until Ctrl-C
    - `workstation virtual-robot --panorama my-room.jpg --radius 2.5 --objects 10 --result run.json`
    - `workstation virtual-robot --calibration calibration/mbot-1`
    - `workstation virtual-robot --right-gain 0.5 --record handicap.mp4 --seconds 60`
    - `workstation virtual-robot --firmware stock.hex` has a board with the real firmware
    """
    import math
    import signal
    import threading
    from types import FrameType

    from mbot_workstation.calibration_files.calibration_folder import (
        CalibrationFiles,
        read_files,
        room_pictures,
    )
    from mbot_workstation.firmware.firmware_file import find_firmware
    from mbot_workstation.simulation.fetch_rules import FetchRules
    from mbot_workstation.simulation.room import load_room
    from mbot_workstation.simulation.room_generator import generate_room
    from mbot_workstation.simulation.scene_renderer import SHOW, TRAINING
    from mbot_workstation.virtual.camera_stream import CameraSettings
    from mbot_workstation.virtual.live_report import LiveReport
    from mbot_workstation.virtual.stand_in import VirtualRobotSettings
    from mbot_workstation.virtual.truth_track import TrackerSettings
    from mbot_workstation.virtual.virtual_session import Outputs, run_session

    files = read_files(calibration) if calibration else CalibrationFiles()
    robot = _robot(
        files.robot,
        gains=(left_gain, right_gain),
        dead_band=dead_band,
        time_constant_ms=time_constant_ms,
        distortion=distortion,
    )
    width_px, height_px = _size(size) if size else _default_size(robot.camera)
    rooms = room_pictures(calibration) if calibration else ()
    panorama = panorama or (rooms[0] if rooms else None)
    try:
        rules = FetchRules(
            spawn_farthest_m=radius,
            objects=objects,
            ends_on_failure=end_on_failure,
            touch_radius_m=robot.touch_radius_m,
        )
    except ValueError as error:
        raise ConfigurationError(f"--radius: {error}") from None
    settings = VirtualRobotSettings(
        robot=robot,
        scene=_free(files.scene) if free_floor else files.scene,
        room_picture=load_room(panorama) if panorama else generate_room(seed),
        rules=rules,
        camera=CameraSettings(
            width_px=width_px,
            height_px=height_px,
            frame_rate_hz=frame_rate,
            latency_s=camera_latency_ms / 1000,
            exposure_s=exposure_ms / 1000,
            exposure_moments=blur_pictures,
            quality=TRAINING if plain else SHOW,
            noise_seed=seed,
            gains=_gains(files.effects),
        ),
        camera_port=camera_port,
        board_link=board or _default_board(),
        boot_s=boot_seconds,
        firmware=find_firmware(firmware) if firmware else None,
        latency_s=files.motion.latency_ms / 1000 if files.motion else 0.0,
        seed=seed,
        free_floor=free_floor,
    )
    noise_mm, noise_deg = truth_noise
    tracker = TrackerSettings(
        position_noise_m=noise_mm / 1000,
        angle_noise_rad=math.radians(noise_deg),
        ahead_m=truth_offset[0] / 1000,
        left_m=truth_offset[1] / 1000,
        seed=seed,
    )
    if not 0 <= noise_mm <= 100 or not 0 <= noise_deg <= 30:
        raise ConfigurationError(
            f"--truth-noise is {noise_mm:g} mm, {noise_deg:g} degrees, expected 0 to 100, 0 to 30"
        )
    outputs = Outputs(
        result=result,
        trajectory=trajectory,
        film=record,
        truth_track=truth_track,
        tracker=tracker,
        ready_file=ready_file,
        view=view,
    )
    stop = threading.Event()

    def ask_to_stop(_number: int, _frame: FrameType | None) -> None:
        stop.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, ask_to_stop)
    run_session(settings, outputs, LiveReport(as_json=as_json), stop, seconds)


def _size(text: str) -> tuple[int, int]:
    width, separator, height = text.lower().partition("x")
    if separator and width.isdecimal() and height.isdecimal():
        size = int(width), int(height)
        if min(size) >= 16 and max(size) <= 4056:
            return size
    raise ConfigurationError(
        f"--size is {text!r}, expected WIDTHxHEIGHT in pixels, 16 to 4056, such as 320x240"
    )


def _default_size(camera: "CameraModel") -> tuple[int, int]:
    """The camera's shape at the size the daemon asks the Pi's camera for."""
    return 320, max(16, round(320 * camera.height_px / camera.width_px))


def _free(scene: "SceneParameters") -> "SceneParameters":
    """The scene with its walls beyond any manoeuvre's reach."""
    from dataclasses import replace

    return replace(scene, arena=replace(scene.arena, wall_m=FREE_FLOOR_M, border_m=FREE_FLOOR_M))


def _gains(effects: "RealWorldEffects") -> tuple[float, float, float]:
    """Of red, green and blue."""
    exposure = effects.exposure_gain
    return exposure * effects.red_gain, exposure, exposure * effects.blue_gain


def _default_board() -> Path:
    import os

    return Path(os.environ.get("XDG_RUNTIME_DIR") or "/tmp") / "mbot-virtual-board"


def _robot(
    nominal: "RobotParameters",
    *,
    gains: tuple[float | None, float | None],
    dead_band: float | None,
    time_constant_ms: float | None,
    distortion: tuple[float, float] | None,
) -> "RobotParameters":
    """The robot, with what the options change about it."""
    from dataclasses import replace

    motors = [nominal.left_motor, nominal.right_motor]
    for side, gain in enumerate(gains):
        if gain is not None:
            motors[side] = replace(motors[side], gain=gain)
        if dead_band is not None:
            motors[side] = replace(motors[side], dead_band=dead_band / 255)
        if time_constant_ms is not None:
            motors[side] = replace(motors[side], time_constant_s=time_constant_ms / 1000)
    camera = nominal.camera
    if distortion is not None:
        camera = replace(camera, distortion=(*distortion, 0.0, 0.0, 0.0))
    return replace(nominal, left_motor=motors[0], right_motor=motors[1], camera=camera)
