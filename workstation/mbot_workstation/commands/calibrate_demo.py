"""`workstation calibrate demo`: the whole afternoon of measuring, on a virtual robot."""

from pathlib import Path
from typing import Annotated

import typer

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.commands.link_options import JsonOption


def calibrate_demo(
    *,
    output: Annotated[
        Path,
        typer.Option("--output", "-o", metavar="FOLDER", help="For all that is made; made anew."),
    ] = Path("out/calibrate-demo"),
    seconds: Annotated[
        float, typer.Option(min=1.5, max=60, help="Of each manoeuvre; the paper has 10.")
    ] = 5.0,
    repetitions: Annotated[
        int, typer.Option(min=2, max=20, help="Of each manoeuvre; the paper has 10.")
    ] = 2,
    photos: Annotated[int, typer.Option(min=6, max=100, help="Of the checkerboard.")] = 20,
    full: Annotated[
        bool, typer.Option("--full", help="As in the paper: 10 times 10 s, which takes 22 min.")
    ] = False,
    maneuver: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Only this one; may be given several times."),
    ] = None,
    worn: Annotated[
        bool,
        typer.Option(
            "--worn", help="A robot with one motor at half force, both slow and weaker backward."
        ),
    ] = False,
    tolerance: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.json", help="Tolerance map for the gap report's verdicts; see `study`."
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of photographs.")] = 1,
    as_json: JsonOption = False,
) -> None:
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

    from mbot_workstation.recordings.maneuver import maneuver_named
    from mbot_workstation.rehearsal.afternoon import REPORT, Afternoon, rehearse
    from mbot_workstation.rehearsal.outcome import as_fields, as_table

    if tolerance is not None and not tolerance.is_file():
        raise ConfigurationError(f"can't read {tolerance}: there is no such file")
    afternoon = Afternoon(
        folder=output,
        seconds=10.0 if full else seconds,
        repetitions=10 if full else repetitions,
        maneuvers=tuple(maneuver_named(name).name for name in maneuver or ()),
        photos=photos,
        worn=worn,
        tolerance=tolerance.absolute() if tolerance is not None else None,
        seed=seed,
    )
    console = Console(stderr=as_json)
    rows = rehearse(afternoon, console)
    if as_json:
        import json

        print(json.dumps(as_fields(rows), indent=2))
        return
    console.print("\n[bold]The truth[/]")
    console.print(as_table(rows))
    console.print(f"\n{output / REPORT}  how far robot and simulation are apart", highlight=False)
