"""The option that names a robot's calibration, for every command that simulates it."""

from pathlib import Path
from typing import Annotated

import typer

CalibrationOption = Annotated[
    Path | None,
    typer.Option(
        "--calibration",
        metavar="FOLDER",
        help="One robot's calibration, such as calibration/mbot-1: simulate that robot, in its "
        "light and, if the folder has any, in its rooms. What it lacks stays nominal.",
    ),
]

DEFAULT_CALIBRATION = Path("calibration/mbot-1")

CalibrationOutputOption = Annotated[
    Path,
    typer.Option(
        "--calibration",
        metavar="FOLDER",
        help="Where this robot's calibration is kept, one folder a robot; made if need be.",
    ),
]
