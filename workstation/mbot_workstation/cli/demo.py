"""`workstation demo`: everything at once, without hardware."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mbot_workstation.cli.link_options import json_option
from mbot_workstation.cli.options import option, output_folder, with_options
from mbot_workstation.cli.simulation_options import calibration_option, object_option

if TYPE_CHECKING:
    from rich.console import Console

    from mbot_workstation.look.demo.demo_result import DemoResult


@dataclass(frozen=True, slots=True, kw_only=True)
class DemoOptions:
    """What `demo` takes."""

    model: Path | None = option(
        None, "The policy to push; the servo if not given.", metavar="MODEL.onnx"
    )
    panorama: Path | None = option(
        None, "360-degree photo of a room; a made-up one otherwise.", metavar="FILE"
    )
    calibration: Path | None = calibration_option()
    object: Path | None = object_option()
    left_gain: float | None = option(
        None, "Left motor's strength; 0.5 is the paper's handicap.", min=0.05, max=2
    )
    right_gain: float | None = option(None, "Right motor's, likewise.", min=0.05, max=2)
    firmware: str | None = option(
        None,
        "Emulate the board's processor with this firmware on it (.elf, .hex); `deadman` "
        "is ours, compiled if need be.",
        metavar="deadman|FILE",
    )
    accept_no_deadman: bool = option(
        False,
        "With --firmware: drive even if it goes on for ever when the daemon dies, as the "
        "stock one does.",
        "--accept-no-deadman",
    )
    seconds: float = option(90.0, "Of driving, at most; ten objects end it early.", min=5, max=3600)
    radius: float = option(1.2, "How far from the middle objects appear.", metavar="METRES")
    seed: int = option(0, "Of the room and the objects.")
    output: Path = output_folder(
        Path("out/demo"), "For recording, pictures and logs.", metavar="FOLDER"
    )
    as_json: bool = json_option()


@with_options
def demo(options: DemoOptions) -> None:
    """Drive a virtual robot with the real daemon: push a policy, watch it, draw what happened.

    Exit code 0 means that at least three objects were touched; 1 otherwise.

    Examples:

    - `workstation demo`
    - `workstation demo --calibration calibration/mbot-1 --model policy.onnx`
    - `workstation demo --left-gain 0.5 --model policy.onnx`: a weak motor
    - `workstation demo --panorama my-room.jpg --radius 2.5 --model policy.onnx`
    - `workstation demo --object models/objects/green-ball.toml --model green-ball.onnx`
    - `workstation demo --firmware deadman` has the real firmware in the loop
    """
    import json
    import sys
    import tempfile
    from dataclasses import asdict

    from rich.console import Console

    from mbot_protocol.policy.policy_contract import PolicyMetadata
    from mbot_workstation.fleet.models.servo_policy import ServoGains, servo_model
    from mbot_workstation.fleet.telemetry.output import JsonLines, LiveView, PlainLines
    from mbot_workstation.look.demo.demo_run import ROBOT_ID, DemoSettings, run_demo

    model = options.model
    robot = _robot_options(options)
    console = Console()
    view = LiveView(ROBOT_ID, console) if console.is_terminal else PlainLines(ROBOT_ID, sys.stdout)
    with tempfile.TemporaryDirectory() as made:
        if model is None:
            model = Path(made) / "servo.onnx"
            policy = servo_model(ServoGains(), PolicyMetadata("servo"))
            model.write_bytes(policy.SerializeToString(deterministic=True))
        # The modelled board harms nobody.
        accepted = options.firmware is None or options.accept_no_deadman
        settings = DemoSettings(
            model, options.output, options.seconds, tuple(robot), options.calibration, accepted
        )
        result = run_demo(settings, JsonLines(sys.stdout, sys.stderr) if options.as_json else view)
    if options.as_json:
        print(json.dumps(asdict(result)))
    else:
        _print(result, options.output, console)
    if not result.success:
        sys.exit(1)


def _robot_options(options: DemoOptions) -> list[str]:
    """What the virtual robot is told; a mistake in a file is better said before anything starts."""
    from mbot_workstation.fleet.firmware.firmware_file import find_firmware
    from mbot_workstation.sim.calibrated.calibration_folder import files_to_simulate
    from mbot_workstation.sim.scene.object_file import read_objects
    from mbot_workstation.sim.scene.room import load_room
    from mbot_workstation.virtual.emulated.board_simulator import simulator_program

    robot = ["--radius", str(options.radius), "--seed", str(options.seed)]
    if options.panorama is not None:
        load_room(options.panorama)
        robot += ["--panorama", str(options.panorama.absolute())]
    if options.calibration is not None:
        files_to_simulate(options.calibration)
        robot += ["--calibration", str(options.calibration.absolute())]
    if options.object is not None:
        read_objects(options.object)
        robot += ["--object", str(options.object.absolute())]
    for name, gain in (("--left-gain", options.left_gain), ("--right-gain", options.right_gain)):
        robot += [] if gain is None else [name, str(gain)]
    if options.firmware is not None:
        simulator_program()  # a missing compiler, too
        robot += ["--firmware", str(find_firmware(options.firmware))]
    return robot


WORDS = {
    "touches": "objects touched",
    "driven_s": "driven, s",
    "distance_driven_m": "distance driven, m",
    "score": "score in the paper's terms",
    "decisions": "decisions",
    "missed_ticks": "missed ticks",
    "decision_p50_ms": "decision to board's reply p50, ms",
    "decision_p99_ms": "decision to board's reply p99, ms",
    "frame_p50_ms": "frame to board's reply p50, ms",
    "frame_p99_ms": "frame to board's reply p99, ms",
    "agent_cpu_share": "daemon's share of one core",
    "agent_memory_mb": "daemon's memory, MB",
    "push_s": "push to active, s",
}


def _print(result: "DemoResult", output: Path, console: "Console") -> None:
    from rich.table import Table

    table = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
    for name, words in WORDS.items():
        table.add_row(words, f"{getattr(result, name):g}")
    deadman = "with" if result.board_has_deadman else "without"
    table.add_row("board's firmware", f"{result.board_version}, {deadman} a dead man's switch")
    console.print(table)
    for file, words in (
        ("contact-sheet.png", "what it saw, and its path from above"),
        ("recording.mcap", "telemetry; opens in Foxglove and Rerun"),
    ):
        console.print(f"{output / file}  {words}", highlight=False)
