"""Leaves runs out whose track has a hole, as the message tells a person to."""

from pathlib import Path

import msgspec

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.measure.tracks.recording_folder import read_recording
from mbot_workstation.measure.tracks.recording_toml import read_info, write_info
from mbot_workstation.measure.tracks.run_check import SPOILT

MOST_SHARE = 0.25
"""A machine that loses more tracks is too slow for real time."""


def leave_out_spoilt(folder: Path) -> tuple[int, ...]:
    """Add to recording.toml the runs that can't be used, one after the other.

    Args:
        folder: of a recording with its track.

    Returns:
        Their numbers.

    Raises:
        ConfigurationError: something else is wrong with the recording, or too many are spoilt.

    """
    spoilt: list[int] = []
    while True:
        try:
            usable = len(read_recording(folder).runs)
        except ConfigurationError as error:
            if error.kind != SPOILT or error.facts["run"] in spoilt:
                raise
            spoilt.append(error.facts["run"])
            info = read_info(folder)
            write_info(folder, msgspec.structs.replace(info, leave_out=tuple(spoilt)))
        else:
            break
    if len(spoilt) > MOST_SHARE * (usable + len(spoilt)):
        raise ConfigurationError(
            f"{len(spoilt)} of {usable + len(spoilt)} tracks have holes: this machine is too busy "
            "to play a robot in real time; try again when it has less to do"
        )
    return tuple(spoilt)
