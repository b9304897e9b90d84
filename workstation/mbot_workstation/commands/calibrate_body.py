"""`workstation calibrate body`: from a scale and a ruler to masses, inertias and a drawing."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.commands.calibration_option import (
    DEFAULT_CALIBRATION,
    CalibrationOutputOption,
)
from mbot_workstation.commands.link_options import JsonOption

if TYPE_CHECKING:
    from mbot_workstation.calibration.body.body_check import Finding
    from mbot_workstation.calibration.body.mass_properties import MassProperties


def body(
    components: Annotated[
        Path | None,
        typer.Argument(
            metavar="COMPONENTS.toml", help="What the robot is made of; start from --example."
        ),
    ] = None,
    *,
    example: Annotated[
        bool,
        typer.Option("--example", help="Print the nominal robot's components, with explanations."),
    ] = False,
    calibration: CalibrationOutputOption = DEFAULT_CALIBRATION,
    drawing: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Where to put the drawing, PNG, PDF or SVG; body.png in the calibration folder "
            "if not given.",
        ),
    ] = None,
    mjcf: Annotated[
        Path | None,
        typer.Option(metavar="FILE.xml", help="Write the robot as MJCF too, for other programs."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Check the robot's components, draw them to scale and write body.toml.

    Hold the drawing against the robot: every component is on it, to scale, on a grid of 10 mm.
    What does not fit together is said; what can't be is refused, and nothing is written.

    Examples:

    - `workstation calibrate body --example > components.toml`
    - `workstation calibrate body components.toml --calibration calibration/mbot-1`
    """
    import msgspec

    from mbot_protocol.toml_file import read_toml
    from mbot_workstation.calibration.body.body_check import examine
    from mbot_workstation.calibration.body.body_example import example_file
    from mbot_workstation.calibration_files.body_calibration import BodyCalibration

    if example:
        print(example_file(), end="")
        return
    if components is None:
        raise ConfigurationError(
            "no COMPONENTS.toml given: `workstation calibrate body --example > components.toml` "
            "writes one to fill in"
        )

    from mbot_workstation.calibration.body.body_drawing import draw_body
    from mbot_workstation.calibration.body.body_mjcf import write_mjcf
    from mbot_workstation.calibration.body.mass_properties import mass_properties
    from mbot_workstation.calibration_files.calibration_folder import (
        CalibrationFiles,
        made_folder,
        read_files,
        write_body,
    )

    measured = read_toml(components, BodyCalibration)
    files = read_files(calibration) if calibration.exists() else CalibrationFiles()
    robot = msgspec.structs.replace(files, body=measured).robot
    whole = mass_properties(measured, robot)
    findings = examine(components, measured, robot, whole)
    picture = drawing or made_folder(calibration) / "body.png"
    draw_body(measured, robot, whole, picture)
    if mjcf is not None:
        write_mjcf(robot, mjcf)
    written = [write_body(calibration, measured), picture, *([mjcf] if mjcf else [])]
    if as_json:
        _print_json(whole, findings, written)
    else:
        _print(whole, findings, written)


def _print_json(whole: "MassProperties", findings: "list[Finding]", written: list[Path]) -> None:
    import json
    from dataclasses import asdict

    import numpy as np

    content = {
        **{
            name: value.tolist() if isinstance(value, np.ndarray) else value
            for name, value in asdict(whole).items()
        },
        "findings": [asdict(finding) for finding in findings],
        "written": [str(path) for path in written],
    }
    print(json.dumps(content))


def _print(whole: "MassProperties", findings: "list[Finding]", written: list[Path]) -> None:
    import numpy as np

    for finding in findings:
        print(f"{finding.verdict:8} {finding.text}")
    if findings:
        print()
    grams, spread = whole.mass_kg * 1000, whole.mass_uncertainty_kg * 1000
    print(f"mass             {grams:.0f} +- {spread:.0f} g")
    for name, place_m, error_m in zip(
        ("ahead of axle", "to the left", "above floor"),
        whole.centre_m,
        whole.centre_uncertainty_m,
        strict=True,
    ):
        print(f"  {name:14} {round(place_m * 1000, 1) + 0.0:.1f} +- {error_m * 1000:.1f} mm")
    axes = np.diag(whole.inertia_kg_m2) * 1e6
    print(f"inertia about it {axes[0]:.0f}, {axes[1]:.0f}, {axes[2]:.0f} kg mm2 about x, y, z")
    print("uncertainties: 95 %")
    for path in written:
        print(f"wrote {path}")
