"""`workstation gap-report`: one page on how far robot and simulation are apart."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.commands.link_options import JsonOption

if TYPE_CHECKING:
    from mbot_workstation.gap_report.report import GapReport


def gap_report(
    *,
    recordings: Annotated[
        list[Path],
        typer.Argument(
            metavar="RECORDING...", help="Folders of `workstation maneuvers run` with their tracks."
        ),
    ],
    calibration: Annotated[
        Path | None,
        typer.Option(
            "--calibration",
            metavar="FOLDER",
            help="The robot's calibration; calibration/ROBOT if not given.",
        ),
    ] = None,
    tolerance: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.json",
            help="What a policy bears: tolerance.json of `workstation study tolerance`. Without, "
            "there are no verdicts.",
        ),
    ] = None,
    frames: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="Pictures of the robot's camera, with frames.csv: file,x_m,y_m,yaw_deg and, where "
            "the cube is in view, cube_x_m,cube_y_m,cube_yaw_deg.",
        ),
    ] = None,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE.html", help="The page.")
    ] = Path("gap.html"),
    as_json: JsonOption = False,
) -> None:
    """Hold the calibrated simulation against the real robot, and write one page about it.

    Paths, errors over time and steady rates of runs that `identify` has not fitted; the lens, the
    light, the same frame real and simulated; and for each quantity a verdict: does a policy bear
    what is left? What is missing is said with the command that makes it. The page needs no other
    file and prints well.

    Examples:

    - `workstation gap-report recordings/mbot-1-2026-11-21`
    - `workstation gap-report recordings/mbot-1-* --calibration calibration/mbot-1
      --tolerance docs/results/tolerance.json --frames frames -o gap.html`
    """
    from datetime import datetime

    from rich.console import Console

    from mbot_workstation.gap_report.building import Sources, build
    from mbot_workstation.gap_report.page import page

    if not output.parent.is_dir():  # said before the work, not after
        raise ConfigurationError(f"can't write {output}: there is no folder {output.parent}")
    today = datetime.now().astimezone().date().isoformat()
    sources = Sources(tuple(recordings), calibration, tolerance, frames, today)
    console = Console(stderr=True)
    with console.status("reading") as status:
        report = build(sources, status.update)
        status.update("drawing the page")
        text = page(report)
    try:
        output.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ConfigurationError(f"can't write {output}: {error.strerror}") from None
    if as_json:
        import json

        from mbot_workstation.gap_report.figures_json import figures

        print(json.dumps(figures(report) | {"path": str(output)}, indent=2))
        return
    _print(report, output)


def _print(report: "GapReport", output: Path) -> None:
    from mbot_workstation.gap_report.summary_section import verdict_lines
    from mbot_workstation.gap_report.wording import degrees, metres, percent, seconds

    after, before = report.calibrated, report.nominal
    print(
        f"{report.held_out} held-out runs; after {seconds(report.driven_s)} the calibrated "
        f"simulation is {metres(after.position_m)} and {degrees(after.yaw_rad)} off (medians), "
        f"the nominal one {metres(before.position_m)} and {degrees(before.yaw_rad)}"
    )
    if after.turned_share is not None:
        print(
            f"of runs that turn, the heading is off by {percent(after.turned_share)} of the angle "
            f"turned, nominal {percent(before.turned_share)}"
        )
    for title, words in verdict_lines(report):
        print(f"{title}: {words}")
    for name, why in report.left_out.items():
        print(f"left out: {name}: {why}")
    for one in report.missing:
        print(f"missing: {one.what}: {one.command}")
    print(f"wrote {output}")
