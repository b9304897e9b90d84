"""`workstation calibrate body`: from a scale and a ruler to masses, inertias and a drawing."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.cli.link_options import json_option
from mbot_workstation.cli.options import argument, option, output_file, with_options
from mbot_workstation.cli.simulation_options import calibration_output_option

if TYPE_CHECKING:
    from mbot_workstation.measure.calibration.body.body_check import Finding
    from mbot_workstation.measure.calibration.body.mass_properties import MassProperties


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
def body(options: BodyOptions) -> None:
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
    from mbot_workstation.measure.calibration.body.body_files import example_file
    from mbot_workstation.sim.calibrated.body_calibration import BodyCalibration

    if options.example:
        print(example_file(), end="")
        return
    if options.components is None:
        raise ConfigurationError(
            "no COMPONENTS.toml given: `workstation calibrate body --example > components.toml` "
            "writes one to fill in"
        )

    from mbot_workstation.measure.calibration.body.body_drawing import draw_body
    from mbot_workstation.measure.calibration.body.body_files import write_mjcf
    from mbot_workstation.measure.calibration.body.mass_properties import mass_properties
    from mbot_workstation.sim.calibrated.calibration_folder import (
        CalibrationFiles,
        made_folder,
        read_files,
        write_body,
    )

    measured = read_toml(options.components, BodyCalibration)
    files = read_files(options.calibration) if options.calibration.exists() else CalibrationFiles()
    robot = msgspec.structs.replace(files, body=measured).robot
    whole = mass_properties(measured, robot)
    findings = examine(options.components, measured, robot, whole)
    picture = options.drawing or made_folder(options.calibration) / "body.png"
    draw_body(measured, robot, whole, picture)
    if options.mjcf is not None:
        write_mjcf(robot, options.mjcf)
    written = [
        write_body(options.calibration, measured),
        picture,
        *([options.mjcf] if options.mjcf else []),
    ]
    if options.as_json:
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
