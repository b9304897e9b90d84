"""`workstation gap-report`: one page on how far robot and simulation are apart."""

import json
from dataclasses import dataclass
from pathlib import Path

from mbot_protocol.files import atomic_file
from mbot_workstation.cli.link_options import json_option
from mbot_workstation.cli.options import argument, option, output_file, with_options

SHIPPED_MAP = Path(__file__).parents[3] / "models" / "tolerance.json"
"""In the checkout, wherever the command is called, beside the policy it is of."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GapReportOptions:
    """What `gap_report` takes."""

    recordings: list[Path] = argument(
        "Folders of `workstation maneuvers run` with their tracks.", metavar="RECORDING..."
    )
    calibration: Path | None = option(
        None,
        "The robot's calibration; calibration/ROBOT if not given.",
        "--calibration",
        metavar="FOLDER",
    )
    tolerance: Path | None = option(
        None,
        "What a policy bears: tolerance.json of `workstation study tolerance`; the one that ships "
        "with the policy, models/tolerance.json, if not given. Without, there are no verdicts.",
        metavar="FILE.json",
    )
    frames: Path | None = option(
        None,
        "Pictures of the robot's camera, with frames.csv: file,x_m,y_m,yaw_deg and, where "
        "the cube is in view, cube_x_m,cube_y_m,cube_yaw_deg.",
        metavar="FOLDER",
    )
    output: Path = output_file(Path("gap.html"), "The page.", "--output", "-o", metavar="FILE.html")
    as_json: bool = json_option()


@with_options
def gap_report(options: GapReportOptions) -> None:
    """Compare the calibrated simulation with the real robot, and write one page about it.

    Paths, errors over time and steady rates of runs that `identify` has not fitted; the lens, the
    light, the same frame real and simulated; and for each quantity a verdict: does a policy bear
    what is left? What is missing is said with the command that makes it. The page needs no other
    file and prints well.

    Examples:

    - `workstation gap-report recordings/mbot-1-2026-11-21`
    - `workstation gap-report recordings/mbot-1-* --calibration calibration/mbot-1
      --tolerance results/tolerance.json --frames frames -o gap.html`
    """
    from rich.console import Console

    from mbot_workstation.measure.gap_report.page import page, printed
    from mbot_workstation.measure.gap_report.report import as_fields, build

    with Console(stderr=True).status("reading") as status:
        report = build(
            options.recordings,
            options.calibration,
            options.tolerance or (SHIPPED_MAP if SHIPPED_MAP.is_file() else None),
            options.frames,
            status.update,
        )
        status.update("drawing the page")
        text = page(report)
    atomic_file.save(options.output, text.encode())
    if options.as_json:
        print(json.dumps(as_fields(report) | {"path": str(options.output)}, indent=2))
        return
    for line in (*printed(report), f"wrote {options.output}"):
        print(line)
