"""Any track file, by its ending."""

from pathlib import Path

from mbot_protocol.errors import ConfigurationError
from mbot_workstation.measure.tracks.track_format import PRESETS, TrackFormat
from mbot_workstation.sim.track import Track

TRACK_SUFFIXES = (".csv", ".tum", ".txt", ".mcap")


def read_track(path: Path, form: TrackFormat | None = None) -> Track:
    """Poses in our frame and units, on the tracker's clock; nothing is cleaned yet.

    Args:
        path: .csv with a declared column map, .tum or .txt in TUM format, .mcap.
        form: as track.toml declares; None: TUM's. A CSV file needs one.

    Raises:
        ConfigurationError: the file can't be read as declared; with the place.

    """
    suffix = path.suffix.lower()
    if suffix not in TRACK_SUFFIXES:
        raise ConfigurationError(
            f"{path} ends in {suffix!r}, expected one of {', '.join(TRACK_SUFFIXES)}"
        )
    if suffix == ".mcap":
        from mbot_workstation.measure.tracks.track_mcap import read_mcap

        form = form or TrackFormat()
        return read_mcap(path, form.topic).to_track(form)
    if suffix == ".csv" and form is None:
        raise ConfigurationError(
            f"{path} needs a track.toml beside it that says what its columns are, such as "
            'preset = "triad-openvr"; see docs/recordings.md'
        )
    from mbot_workstation.measure.tracks.track_table import read_table

    form = form or PRESETS["tum"]
    return read_table(path, form).to_track(form)
