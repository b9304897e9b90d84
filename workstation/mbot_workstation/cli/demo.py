"""Try it without hardware: everything at once, and a policy that needs no training."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.policy.policy_contract import FULL_VIEW
from mbot_workstation.cli.common_options import calibration_option, json_option, object_option
from mbot_workstation.cli.options import argument, option, output_folder, with_options
from mbot_workstation.cli.presenter import Answer, table
from mbot_workstation.wording import typed

if TYPE_CHECKING:
    from rich.console import RenderableType

    from mbot_workstation.look.demo.demo_result import DemoResult

POLICY_NAME = "servo"

SIGN_OF_LIFE_S = 15.0
"""In a pipe nobody watches; what happened stands in the table at the end."""


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
    object: Path | None = object_option(
        "What there is to fetch; what the policy was trained for if not given."
    )
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
def demo(options: DemoOptions) -> Answer:
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
    import tempfile

    from mbot_protocol.policy.policy_contract import PolicyMetadata
    from mbot_workstation.fleet.models.servo_policy import ServoGains, servo_model
    from mbot_workstation.fleet.models.written_policy import write_policy
    from mbot_workstation.fleet.telemetry.output import output_for
    from mbot_workstation.look.demo.demo_run import ROBOT_ID, DemoSettings, run_demo

    model = options.model
    robot = _robot_options(options)
    with tempfile.TemporaryDirectory() as made:
        if model is None:
            model = Path(made) / "servo.onnx"
            policy = servo_model(ServoGains(), PolicyMetadata(POLICY_NAME))
            write_policy(model, POLICY_NAME, policy)
        # The modelled board harms nobody.
        accepted = options.firmware is None or options.accept_no_deadman
        settings = DemoSettings(
            model, options.output, options.seconds, tuple(robot), options.calibration, accepted
        )
        shown = output_for(ROBOT_ID, as_json=options.as_json, line_every_s=SIGN_OF_LIFE_S)
        result = run_demo(settings, shown)
    return Answer(result, _demo_words(result, options.output), exit_code=0 if result.success else 1)


def _robot_options(options: DemoOptions) -> list[str]:
    """What the virtual robot is told; a mistake in a file is better said before anything starts."""
    from mbot_workstation.fleet.firmware.firmware_file import find_firmware
    from mbot_workstation.fleet.models.trained_object import objects_of, trained_object
    from mbot_workstation.sim.calibrated.calibration_folder import files_to_simulate
    from mbot_workstation.sim.scene.room import load_room
    from mbot_workstation.virtual.emulated.board_simulator import simulator_program

    robot = ["--radius", str(options.radius), "--seed", str(options.seed)]
    if options.panorama is not None:
        load_room(options.panorama)
        robot += ["--panorama", str(options.panorama.absolute())]
    if options.calibration is not None:
        files_to_simulate(options.calibration)
        robot += ["--calibration", str(options.calibration.absolute())]
    thing = options.object
    if thing is None and options.model is not None and trained_object(options.model):
        thing = options.model
    if thing is not None:
        objects_of(thing)
        robot += ["--object", str(thing.absolute())]
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


def _demo_words(result: "DemoResult", output: Path) -> "Iterator[RenderableType]":
    rows = [(words, f"{getattr(result, name):g}") for name, words in WORDS.items()]
    deadman = "with" if result.board_has_deadman else "without"
    board = f"{result.board_version}, {deadman} a dead man's switch"
    yield table(("", ""), [*rows, ("board's firmware", board)])
    yield f"{output / 'contact-sheet.png'}  what it saw, and its path from above"
    yield f"{output / 'recording.mcap'}  telemetry; opens in Foxglove and Rerun"


@dataclass(frozen=True, slots=True, kw_only=True)
class MakeServoPolicyOptions:
    """What `make_servo_policy` takes."""

    output: Path = argument("The ONNX file to write.", default=Path("servo.onnx"))
    search_speed: float | None = option(
        None,
        "Wheel speed of the search turn, share of full speed; 0.25 if not given. Less if "
        "the robot spins past the cube, more if it hardly turns.",
        min=0.05,
        max=1.0,
    )
    view: tuple[float, float] = option(
        (FULL_VIEW.horizontal_deg, FULL_VIEW.vertical_deg),
        "Field of view of the observation, degrees.",
        metavar="WIDTH HEIGHT",
    )
    as_json: bool = json_option()


@with_options
def make_servo_policy(options: MakeServoPolicyOptions) -> Answer:
    """Write a policy that needs no training: it drives at the red cube, or turns to find it.

    Robots take it as they take a trained model, and a trained model has to beat it. The same
    options give the same file.

    Example: `workstation make-servo-policy servo.onnx`, then `workstation push-model servo.onnx`
    """
    from dataclasses import replace

    from mbot_protocol.policy.policy_contract import FieldOfView, PolicyMetadata
    from mbot_workstation.fleet.models.servo_policy import ServoGains, servo_model
    from mbot_workstation.fleet.models.written_policy import write_policy

    try:
        metadata = PolicyMetadata(POLICY_NAME, FieldOfView(*options.view))
    except ValueError as error:
        raise ConfigurationError(f"--view: {error}") from None
    gains = ServoGains()
    if options.search_speed is not None:
        gains = replace(gains, search_speed=options.search_speed)
    made = write_policy(options.output, POLICY_NAME, servo_model(gains, metadata))
    return Answer(made, [made.sentence(f"workstation push-model {typed(made.path)}")])
