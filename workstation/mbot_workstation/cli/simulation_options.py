"""What commands ask for that simulate a robot: its calibration, its rooms, a lesson."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.cli.options import option

if TYPE_CHECKING:
    from mbot_workstation.tasks.lesson import Lesson

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


def object_option() -> Any:
    """--object for commands that simulate a room."""
    return option(
        None,
        "What there is to fetch in place of the red cube: shape, size, colour; several kinds if "
        "you like. See models/objects and docs/objects.md.",
        "--object",
        metavar="FILE.toml",
    )


def task_option(panel: str = "") -> Any:
    """--task for commands that simulate a robot at work."""
    return option(
        "fetch",
        "What robots are to do: fetch, or a task of your own, FILE.py, which is run.",
        "--task",
        metavar="NAME|FILE.py",
        panel=panel,
    )


def calibration_output_option() -> Any:
    """--calibration for commands that measure a robot."""
    return option(
        DEFAULT_CALIBRATION,
        "Where this robot's calibration is kept, one folder a robot; made if need be.",
        "--calibration",
        metavar="FOLDER",
    )


def photographs(panoramas: Sequence[Path] | None, calibration: Path | None) -> list[Path]:
    """The panoramas that were given, and those in a calibration's folder."""
    from mbot_workstation.sim.calibrated.calibration_folder import room_pictures

    return [*(panoramas or ()), *(room_pictures(calibration) if calibration else ())]


def find_lesson(name: str | None, task: str) -> "Lesson":
    """The lesson of a task that --lesson names, or the last of its course.

    Raises:
        ConfigurationError: there is none, or no such task.

    """
    from mbot_workstation.tasks.find import find_task
    from mbot_workstation.tasks.lesson import lesson_named

    found = find_task(task)
    try:
        return lesson_named(found.lessons, name or found.course(guided=False, further=False)[-1])
    except ValueError as error:
        raise ConfigurationError(f"--lesson: {error}") from None
