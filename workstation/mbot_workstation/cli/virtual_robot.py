"""`workstation virtual-robot`: a robot without hardware, for the same daemon as on the Pi."""

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from mbot_workstation.cli.options import option, output_file, with_options
from mbot_workstation.cli.simulation_options import (
    calibration_option,
    object_option,
    task_option,
)

_TASK, _ROBOT, _CAMERA = "Task", "Robot", "Camera"
_OUTPUT = "What is left of it"


class CameraKind(StrEnum):
    """How its camera sees light."""

    FIXED = "fixed"
    PI = "pi"


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
    calibration: Path | None = calibration_option()
    object: Path | None = object_option()
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
        "Speed of 255 up to which wheels stand; 50 without a calibration.",
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
    - `workstation virtual-robot --right-gain 0.5 --record handicap.mp4 --seconds 60`
    - `workstation virtual-robot --firmware stock.hex` has a board with the real firmware
    - `workstation virtual-robot --replay drives/mbot-1/drive-0012-20261122-171501`
    """
    from mbot_workstation.cli.stop_signals import stop_signals
    from mbot_workstation.cli.virtual_robot_settings import (
        outputs,
        replay_settings,
        robot_settings,
    )
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
