"""`workstation demo`: everything at once, without hardware."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mbot_workstation.commands.calibration_option import CalibrationOption
from mbot_workstation.commands.link_options import JsonOption

if TYPE_CHECKING:
    from rich.console import Console

    from mbot_workstation.demo.demo_run import DemoResult


def demo(
    *,
    model: Annotated[
        Path | None,
        typer.Option(metavar="MODEL.onnx", help="The policy to push; the servo if not given."),
    ] = None,
    panorama: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="360-degree photo of a room; a made-up one otherwise."),
    ] = None,
    calibration: CalibrationOption = None,
    firmware: Annotated[
        str | None,
        typer.Option(
            metavar="deadman|FILE",
            help="Emulate the board's processor with this firmware on it (.elf, .hex); `deadman` "
            "is ours, compiled if need be.",
        ),
    ] = None,
    accept_no_deadman: Annotated[
        bool,
        typer.Option(
            "--accept-no-deadman",
            help="With --firmware: drive even if it goes on for ever when the daemon dies, as the "
            "stock one does.",
        ),
    ] = False,
    seconds: Annotated[
        float, typer.Option(min=5, max=3600, help="Of driving, at most; ten objects end it early.")
    ] = 90.0,
    radius: Annotated[
        float, typer.Option(metavar="METRES", help="How far from the middle objects appear.")
    ] = 1.2,
    seed: Annotated[int, typer.Option(help="Of the room and the objects.")] = 0,
    output: Annotated[
        Path, typer.Option(metavar="FOLDER", help="For recording, pictures and logs.")
    ] = Path("out/demo"),
    as_json: JsonOption = False,
) -> None:
    """Drive a virtual robot with the real daemon: push a policy, watch it, draw what happened.

    Exit code 0 means that at least three objects were touched; 1 that not.

    Examples:

    - `workstation demo`
    - `workstation demo --calibration calibration/mbot-1 --model policy.onnx`
    - `workstation demo --panorama my-room.jpg --radius 2.5 --model policy.onnx`
    - `workstation demo --firmware deadman` has the real firmware in the loop
    """
    import json
    import sys
    import tempfile
    from dataclasses import asdict

    from rich.console import Console

    from mbot_protocol.policy_contract import PolicyMetadata
    from mbot_workstation.calibration_files.calibration_folder import read_files
    from mbot_workstation.demo.demo_run import ROBOT_ID, DemoSettings, run_demo
    from mbot_workstation.firmware.firmware_file import find_firmware
    from mbot_workstation.models.servo_policy import ServoGains, servo_model
    from mbot_workstation.telemetry.output import JsonLines, LiveView, PlainLines
    from mbot_workstation.virtual.emulated.board_simulator import simulator_program

    options = ["--radius", str(radius), "--seed", str(seed)]
    if panorama is not None:
        options += ["--panorama", str(panorama.absolute())]
    if calibration is not None:
        read_files(calibration)  # a mistake in it is better said before anything starts
        options += ["--calibration", str(calibration.absolute())]
    if firmware is not None:
        simulator_program()  # a missing compiler, likewise
        options += ["--firmware", str(find_firmware(firmware))]
    console = Console()
    view = LiveView(ROBOT_ID, console) if console.is_terminal else PlainLines(ROBOT_ID, sys.stdout)
    with tempfile.TemporaryDirectory() as made:
        if model is None:
            model = Path(made) / "servo.onnx"
            policy = servo_model(ServoGains(), PolicyMetadata("servo"))
            model.write_bytes(policy.SerializeToString(deterministic=True))
        accepted = firmware is None or accept_no_deadman  # the modelled board harms nobody
        settings = DemoSettings(model, output, seconds, tuple(options), calibration, accepted)
        result = run_demo(settings, JsonLines(sys.stdout, sys.stderr) if as_json else view)
    if as_json:
        print(json.dumps(asdict(result)))
    else:
        _print(result, output, console)
    if not result.success:
        sys.exit(1)


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
