"""The option that names a robot's calibration, for every command that simulates it."""

from pathlib import Path
from typing import Any

from mbot_workstation.commands.options import option

DEFAULT_CALIBRATION = Path("calibration/mbot-1")


def calibration_option() -> Any:
    """--calibration for commands that simulate a robot."""
    return option(
        None,
        "One robot's calibration, such as calibration/mbot-1: simulate that robot, in its light "
        "and, if the folder has any, in its rooms. What it lacks stays nominal.",
        "--calibration",
        metavar="FOLDER",
    )


def calibration_output_option() -> Any:
    """--calibration for commands that measure a robot."""
    return option(
        DEFAULT_CALIBRATION,
        "Where this robot's calibration is kept, one folder a robot; made if need be.",
        "--calibration",
        metavar="FOLDER",
    )
