"""`workstation virtual-robot`: a robot without hardware, for the same daemon as on the Pi."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mbot_protocol.errors import ConfigurationError

if TYPE_CHECKING:
    from mbot_workstation.simulation.robot_parameters import RobotParameters

_TASK, _ROBOT, _CAMERA = "Task", "Robot", "Camera"
_OUTPUT = "What is left of it"


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
    left_gain: Annotated[
        float,
        typer.Option(min=0.05, max=2, help="Left motor's strength.", rich_help_panel=_ROBOT),
    ] = 1.0,
    right_gain: Annotated[
        float,
        typer.Option(
            min=0.05,
            max=2,
            help="Right motor's; 0.5 is the paper's handicap.",
            rich_help_panel=_ROBOT,
        ),
    ] = 1.0,
    dead_band: Annotated[
        float,
        typer.Option(
            min=0, max=250, help="Speed of 255 up to which wheels stand.", rich_help_panel=_ROBOT
        ),
    ] = 50.0,
    time_constant_ms: Annotated[
        float, typer.Option(min=5, max=2000, help="Of a wheel's speed.", rich_help_panel=_ROBOT)
    ] = 90.0,
    boot_seconds: Annotated[
        float,
        typer.Option(
            min=0,
            max=60,
            help="A real board resets when its port is opened and is deaf for about 3 s; so does "
            "this one if above 0.",
            rich_help_panel=_ROBOT,
        ),
    ] = 0.0,
    frame_rate: Annotated[
        float, typer.Option(metavar="HZ", min=1, max=120, rich_help_panel=_CAMERA)
    ] = 30.0,
    size: Annotated[
        str, typer.Option(metavar="WIDTHxHEIGHT", help="In pixels.", rich_help_panel=_CAMERA)
    ] = "320x240",
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
        tuple[float, float],
        typer.Option(
            metavar="K1 K2", help="Of the lens, as OpenCV counts it.", rich_help_panel=_CAMERA
        ),
    ] = (0.0, 0.0),
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
    - `workstation virtual-robot --right-gain 0.5 --record handicap.mp4 --seconds 60`
    """
    import signal
    import threading
    from types import FrameType

    from mbot_workstation.simulation.fetch_rules import FetchRules
    from mbot_workstation.simulation.room import load_room
    from mbot_workstation.simulation.room_generator import generate_room
    from mbot_workstation.simulation.scene_renderer import SHOW, TRAINING
    from mbot_workstation.virtual.camera_stream import CameraSettings
    from mbot_workstation.virtual.live_report import LiveReport
    from mbot_workstation.virtual.session import Outputs, run_session
    from mbot_workstation.virtual.virtual_robot import VirtualRobotSettings

    width_px, height_px = _size(size)
    robot = _robot(
        gains=(left_gain, right_gain),
        dead_band=dead_band / 255,
        time_constant_s=time_constant_ms / 1000,
        distortion=distortion,
        size_px=(width_px, height_px),
    )
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
        ),
        camera_port=camera_port,
        board_link=board or _default_board(),
        boot_s=boot_seconds,
        seed=seed,
    )
    outputs = Outputs(
        result=result, trajectory=trajectory, film=record, ready_file=ready_file, view=view
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


def _default_board() -> Path:
    import os

    return Path(os.environ.get("XDG_RUNTIME_DIR") or "/tmp") / "mbot-virtual-board"


def _robot(
    *,
    gains: tuple[float, float],
    dead_band: float,
    time_constant_s: float,
    distortion: tuple[float, float],
    size_px: tuple[int, int],
) -> "RobotParameters":
    from dataclasses import replace

    from mbot_protocol.camera_model import nominal_pi_camera
    from mbot_workstation.simulation.robot_parameters import MotorParameters, RobotParameters

    left, right = (MotorParameters(gain, dead_band, time_constant_s) for gain in gains)
    camera = replace(nominal_pi_camera(*size_px), distortion=(*distortion, 0.0, 0.0, 0.0))
    return RobotParameters(left_motor=left, right_motor=right, camera=camera)
