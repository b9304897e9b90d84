"""`workstation calibrate` and `panorama`: measurements of one robot, files of its calibration."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.cli.calibrate_camera import camera, light
from mbot_workstation.cli.common_options import calibration_output_option, json_option
from mbot_workstation.cli.options import (
    argument,
    option,
    output_file,
    output_folder,
    with_options,
)
from mbot_workstation.cli.presenter import Answer, plain

if TYPE_CHECKING:
    from mbot_workstation.measure.calibration.body.body_check import Finding
    from mbot_workstation.measure.calibration.body.mass_properties import MassProperties
    from mbot_workstation.measure.calibration.room.panorama_import import ImportedRoom

app = typer.Typer(
    help="Measure one robot; simulation, training and the daemon then use what is written.",
    no_args_is_help=True,
    rich_markup_mode="markdown",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class BodyOptions:
    """What `body` takes."""

    components: Path | None = argument(
        "What the robot is made of; start from --example.", default=None, metavar="COMPONENTS.toml"
    )
    example: bool = option(
        False, "Print the nominal robot's components, with explanations.", "--example"
    )
    calibration: Path = calibration_output_option()
    drawing: Path | None = output_file(
        None,
        "Where to put the drawing, PNG, PDF or SVG; body.png in the calibration folder "
        "if not given.",
        metavar="FILE",
    )
    mjcf: Path | None = output_file(
        None, "Write the robot as MJCF too, for other programs.", metavar="FILE.xml"
    )
    as_json: bool = json_option()


@with_options
def body(options: BodyOptions) -> Answer | None:
    """Check the robot's components, draw them to scale and write body.toml.

    Hold the drawing against the robot: every component is on it, to scale, on a grid of 10 mm.
    What does not fit together is said; what can't be is refused, and nothing is written.

    Examples:

    - `workstation calibrate body --example > components.toml`
    - `workstation calibrate body components.toml --calibration calibration/mbot-1`
    """
    import msgspec

    from mbot_protocol.files.toml_file import read_toml
    from mbot_workstation.measure.calibration.body.body_check import examine
    from mbot_workstation.measure.calibration.body.body_drawing import draw_body
    from mbot_workstation.measure.calibration.body.body_files import example_file, write_mjcf
    from mbot_workstation.measure.calibration.body.mass_properties import mass_properties
    from mbot_workstation.sim.calibrated.body_calibration import BodyCalibration
    from mbot_workstation.sim.calibrated.calibration_folder import (
        CalibrationFiles,
        made_folder,
        read_files,
        write_body,
    )

    if options.example:
        print(example_file(), end="")
        return None
    if options.components is None:
        raise ConfigurationError(
            "no COMPONENTS.toml given: `workstation calibrate body --example > components.toml` "
            "writes one to fill in"
        )
    measured = read_toml(options.components, BodyCalibration)
    files = read_files(options.calibration) if options.calibration.exists() else CalibrationFiles()
    robot = msgspec.structs.replace(files, body=measured).robot
    whole = mass_properties(measured, robot)
    findings = examine(options.components, measured, robot, whole)
    picture = options.drawing or made_folder(options.calibration) / "body.png"
    draw_body(measured, robot, whole, picture)
    written = [write_body(options.calibration, measured), picture]
    if options.mjcf is not None:
        write_mjcf(robot, options.mjcf)
        written.append(options.mjcf)
    value = {**plain(whole), "findings": findings, "written": written}
    return Answer(value, _body_words(whole, findings, written))


def _body_words(
    whole: "MassProperties", findings: "list[Finding]", written: list[Path]
) -> Iterator[str]:
    import numpy as np

    for finding in findings:
        yield f"{finding.verdict:8} {finding.text}"
    if findings:
        yield ""
    grams, spread = whole.mass_kg * 1000, whole.mass_uncertainty_kg * 1000
    yield f"mass             {grams:.0f} +- {spread:.0f} g"
    for name, place_m, error_m in zip(
        ("ahead of axle", "to the left", "above floor"),
        whole.centre_m,
        whole.centre_uncertainty_m,
        strict=True,
    ):
        yield f"  {name:14} {round(place_m * 1000, 1) + 0.0:.1f} +- {error_m * 1000:.1f} mm"
    axes = np.diag(whole.inertia_kg_m2) * 1e6
    yield f"inertia about it {axes[0]:.0f}, {axes[1]:.0f}, {axes[2]:.0f} kg mm2 about x, y, z"
    yield "uncertainties: 95 %"
    for path in written:
        yield f"wrote {path}"


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrateDemoOptions:
    """What `calibrate_demo` takes."""

    output: Path = output_folder(
        Path("out/calibrate-demo"),
        "For all that is made; replaced each time.",
        "--output",
        "-o",
        metavar="FOLDER",
    )
    seconds: float = option(5.0, "Of each maneuver; the paper has 10.", min=1.5, max=60)
    repetitions: int = option(2, "Of each maneuver; the paper has 10.", min=2, max=20)
    photos: int = option(20, "Of the checkerboard.", min=10, max=100)
    full: bool = option(False, "As in the paper: 10 times 10 s, which takes 22 min.", "--full")
    maneuver: list[str] | None = option(
        None, "Only this one; may be given several times.", metavar="NAME"
    )
    worn: bool = option(
        False, "A robot with one motor at half force, both slow and weaker backward.", "--worn"
    )
    tolerance: Path | None = option(
        None, "Tolerance map for the gap report's verdicts; see `study`.", metavar="FILE.json"
    )
    seed: int = option(1, "Of photographs.", min=0)
    as_json: bool = json_option()


@with_options
def calibrate_demo(options: CalibrateDemoOptions) -> Answer:
    """Rehearse the afternoon of measuring on a virtual robot that nobody has measured yet.

    The robot differs from the nominal one in motors, wheels, delay, lens and light. Every step is
    done by the command that a person types, which is shown; where a person would hold a camera or
    a scale, the virtual world answers. At the end the truth is opened and compared.

    Examples:

    - `workstation calibrate demo`
    - `workstation calibrate demo --full -o out/full`
    - `workstation calibrate demo --worn -o out/worn`
    """
    from rich.console import Console

    from mbot_workstation.measure.rehearsal.afternoon import REPORT, Afternoon, rehearse
    from mbot_workstation.measure.rehearsal.outcome import as_table, outcome_answer
    from mbot_workstation.measure.tracks.maneuver import maneuver_named

    if options.tolerance is not None and not options.tolerance.is_file():
        raise ConfigurationError(f"can't read {options.tolerance}: there is no such file")
    afternoon = Afternoon(
        folder=options.output,
        seconds=10.0 if options.full else options.seconds,
        repetitions=10 if options.full else options.repetitions,
        maneuvers=tuple(maneuver_named(name).name for name in options.maneuver or ()),
        photos=options.photos,
        worn=options.worn,
        tolerance=options.tolerance.absolute() if options.tolerance is not None else None,
        seed=options.seed,
    )
    rows = rehearse(afternoon, Console(stderr=options.as_json))
    page = f"\n{options.output / REPORT}  how far robot and simulation are apart"
    return Answer(outcome_answer(rows), ["\nThe truth", as_table(rows), page])


app.command("body")(body)
app.command("camera")(camera)
app.command("light")(light)
app.command("demo")(calibrate_demo)


@dataclass(frozen=True, slots=True, kw_only=True)
class PanoramaOptions:
    """What `panorama` takes."""

    photo: Path = argument("A 360-degree photo, twice as wide as high.", metavar="PHOTO")
    calibration: Path = calibration_output_option()
    name: str | None = option(None, "Of the room; the photo's if not given.", metavar="NAME")
    heading: float = option(
        0.0,
        "Where the robot looks first, to the right of the photo's middle.",
        metavar="DEGREES",
        min=-360,
        max=360,
    )
    pitch: float | None = option(
        None,
        "How far the photo's middle is above the horizon; with --roll, instead of asking "
        "the upright edges.",
        metavar="DEGREES",
        min=-45,
        max=45,
    )
    roll: float | None = option(
        None, "How far the camera was turned clockwise.", metavar="DEGREES", min=-45, max=45
    )
    width: int | None = option(
        None,
        "A power of two; if not given, what the photo fills, up to 2048: as fine as the "
        "robot's camera sees. Each simulation keeps the room in memory.",
        metavar="PIXELS",
    )
    force: bool = option(False, "Take it even if it doesn't look like a whole panorama.", "--force")
    as_json: bool = json_option()


@dataclass(frozen=True, slots=True)
class RoomAnswer:
    """A room of the calibration, and how its photo was levelled."""

    pitch_deg: float
    roll_deg: float
    upright_edges: int
    width_px: int
    height_px: int
    notes: list[str]
    path: Path
    preview: Path


@with_options
def panorama(options: PanoramaOptions) -> Answer:
    """Check a 360-degree photo, level and turn it, and keep it as a room of the calibration.

    Take it from the middle of the arena, from a tripod at about 1.2 m, with the light as it is when
    the robot drives. It goes to rooms/NAME.jpg, and previews/NAME.png shows what the robot will
    see. `workstation train --calibration` and `virtual-robot --calibration` use it then.

    Examples:

    - `workstation panorama my-room.jpg`
    - `workstation panorama R0010042.JPG --name lab --heading 90 --calibration calibration/mbot-2`
    """
    from mbot_workstation.measure.calibration.room.panorama_import import (
        check_width,
        prepare_room,
        write_room,
    )
    from mbot_workstation.measure.calibration.room.panorama_preview import write_preview

    if options.width is not None:
        check_width(options.width)
    given = options.pitch is not None or options.roll is not None
    called = options.photo.stem if options.name is None else options.name
    if not called or called.startswith(".") or Path(called).name != called:
        raise ConfigurationError(f"--name is {called!r}, expected a plain name such as lab")
    room = prepare_room(
        options.photo,
        width_px=options.width,
        heading_deg=options.heading,
        tilt_deg=(options.pitch or 0.0, options.roll or 0.0) if given else None,
        whole=not options.force,
    )
    height_px, width_px = room.picture.shape[:2]
    imported = RoomAnswer(
        room.pitch_deg,
        room.roll_deg,
        room.tilt.edges if room.tilt else 0,
        width_px,
        height_px,
        list(room.notes),
        write_room(options.calibration, called, room.picture),
        write_preview(options.calibration, called, room.picture),
    )
    said = [
        _levelled(room, given=given),
        *(f"note: {words}" for words in room.notes),
        f"wrote {imported.path}, {width_px} x {height_px}",
        f"wrote {imported.preview}: look whether it is level, and not mirrored",
    ]
    return Answer(imported, said)


def _levelled(room: "ImportedRoom", *, given: bool) -> str:
    tilt = f"pitch {room.pitch_deg:+.1f}, roll {room.roll_deg:+.1f} degrees"
    if given:
        return f"levelled by {tilt}, as given"
    if room.tilt is None:
        return "not levelled"
    if room.pitch_deg == room.roll_deg == 0:
        return f"level already, as {room.tilt.edges} upright edges say"
    return f"levelled by {tilt}, as {room.tilt.edges} upright edges say"
