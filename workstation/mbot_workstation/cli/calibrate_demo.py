"""`workstation calibrate demo`: the whole afternoon of measuring, on a virtual robot."""

from dataclasses import dataclass
from pathlib import Path

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.cli.link_options import json_option
from mbot_workstation.cli.options import option, output_folder, with_options


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrateDemoOptions:
    """What `calibrate_demo` takes."""

    output: Path = output_folder(
        Path("out/calibrate-demo"),
        "For all that is made; made anew.",
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
def calibrate_demo(options: CalibrateDemoOptions) -> None:
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
    from mbot_workstation.measure.rehearsal.outcome import as_fields, as_table
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
    console = Console(stderr=options.as_json)
    rows = rehearse(afternoon, console)
    if options.as_json:
        import json

        print(json.dumps(as_fields(rows), indent=2))
        return
    console.print("\n[bold]The truth[/]")
    console.print(as_table(rows))
    console.print(
        f"\n{options.output / REPORT}  how far robot and simulation are apart", highlight=False
    )
