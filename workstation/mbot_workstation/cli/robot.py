"""`workstation robot`: another robot than an mBot."""

from dataclasses import dataclass
from pathlib import Path

import typer

from mbot_workstation.cli.common_options import json_option
from mbot_workstation.cli.options import argument, option, output_folder, with_options
from mbot_workstation.cli.presenter import Answer
from mbot_workstation.wording import typed

app = typer.Typer(
    help="Describe another robot than an mBot.", no_args_is_help=True, rich_markup_mode="markdown"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class NewRobotOptions:
    """What `new` takes."""

    name: str = argument("The robot's, as its daemon will have it.", metavar="NAME")
    wheelbase: float = option(115.0, "Between the wheels' middles, in mm.", metavar="MM")
    wheel_diameter: float = option(65.0, "In mm.", metavar="MM")
    top_speed: float = option(
        0.4, "Straight ahead at full power, in m/s: time it over 2 m.", metavar="M/S"
    )
    camera_height: float = option(75.0, "Of the lens above the floor, in mm.", metavar="MM")
    camera_ahead: float = option(60.0, "Of the lens ahead of the axle, in mm.", metavar="MM")
    camera_pitch: float = option(
        5.0, "How far it looks down from the horizon, in degrees.", metavar="DEG"
    )
    mass: float = option(940.0, "Of the whole robot, in g.", metavar="G")
    board: str = option("mcore", "mcore, serial-line or gpio.", metavar="KIND")
    output: Path | None = output_folder(
        None, "calibration/NAME if not given.", "--output", "-o", metavar="FOLDER"
    )
    as_json: bool = json_option()


@dataclass(frozen=True, slots=True)
class RobotWritten:
    """A robot's folder, its files, and what follows from its top speed."""

    folder: Path
    files: list[Path]
    free_speed_rpm: float


@app.command()
@with_options
def new(options: NewRobotOptions) -> Answer:
    """Write a robot's folder from a ruler and a stopwatch: simulate it, and configure its daemon.

    What is not given is as on an mBot. The folder is a calibration as measured robots have one:
    `evaluate`, `train`, `virtual-robot`, `demo` and `study` take it by --calibration, and what is
    measured later (`calibrate`, `identify`) replaces its files. docs/other-robots.md goes on.

    Examples:

    - `workstation robot new rover --wheelbase 150 --wheel-diameter 40 --top-speed 0.25 --board
      serial-line`
    - `workstation robot new rover --camera-height 120 --camera-pitch 15 --board gpio -o rover`
    """
    from mbot_workstation.sim.calibrated.new_robot import NewRobot, write_new_robot

    robot = NewRobot(
        name=options.name,
        board=options.board,
        wheelbase_m=options.wheelbase / 1000,
        wheel_diameter_m=options.wheel_diameter / 1000,
        top_speed_m_s=options.top_speed,
        camera_height_m=options.camera_height / 1000,
        camera_ahead_m=options.camera_ahead / 1000,
        camera_pitch_deg=options.camera_pitch,
        mass_kg=options.mass / 1000,
    )
    folder = options.output or Path("calibration") / robot.name
    files = write_new_robot(robot, folder)
    said = [
        f"wrote {folder}: {', '.join(path.name for path in files)}",
        f"its wheels turn at {robot.free_speed_rpm:.0f} rpm without load; weigh and measure the "
        f"rest by `workstation calibrate body`",
        f"next: workstation evaluate models/red-cube.onnx --calibration {typed(folder)}",
    ]
    return Answer(RobotWritten(folder, files, round(robot.free_speed_rpm, 1)), said)
