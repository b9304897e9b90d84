"""`recording.toml`: whose recording it is, and how its motors were driven."""

from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta, Struct

from mbot_protocol.drive.actions import MotorMap, WheelMaps
from mbot_protocol.errors import ConfigurationError
from mbot_protocol.files import atomic_file
from mbot_protocol.files.text_file import text_if_any
from mbot_protocol.files.toml_file import decode_toml
from mbot_protocol.wire.keys import check_robot_id

RECORDING_FILE = "recording.toml"


class RecordingInfo(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """The file.

    Attributes:
        robot_id: whose.
        made_on: ISO date.
        clock_began_unix_s: the wall clock's time when the robot's clock was 0; 0: not known.
        clock_uncertainty_ms: how well the commands' times are known on the robot's clock.
        left, right: the daemon's maps; what is left out is nominal.
        leave_out: numbers of runs that are not to be used.

    """

    robot_id: str
    made_on: str = ""
    clock_began_unix_s: float = 0.0
    clock_uncertainty_ms: Annotated[float, Meta(ge=0)] = 0.0
    left: MotorMap = MotorMap()
    right: MotorMap = MotorMap()
    leave_out: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        try:
            check_robot_id(self.robot_id)
        except ConfigurationError as error:
            raise ValueError(str(error)) from None

    @property
    def wheel_maps(self) -> WheelMaps:
        """Both wheels' maps."""
        return WheelMaps(self.left, self.right)


def read_info(folder: Path) -> RecordingInfo:
    """Read the folder's file.

    Raises:
        ConfigurationError: missing or unusable; with the key.

    """
    path = folder / RECORDING_FILE
    text = text_if_any(path)
    if text is None:
        raise ConfigurationError(
            f"{folder} is not a recording: there is no {RECORDING_FILE} in it; "
            "see docs/recordings.md"
        )
    return decode_toml(text, RecordingInfo, str(path))


def write_info(folder: Path, info: RecordingInfo) -> None:
    """Write the folder's file whole or not at all; raises OSError."""
    import tomli_w

    fields = {key: value for key, value in msgspec.to_builtins(info).items() if value != {}}
    atomic_file.replace(folder / RECORDING_FILE, tomli_w.dumps(fields).encode())
