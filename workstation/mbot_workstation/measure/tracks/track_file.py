"""Track files: read by their ending; written in TUM format, whole or pose by pose."""

import io
import time
from pathlib import Path
from typing import Self

import numpy as np

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.files import atomic_file
from mbot_workstation.measure.tracks.track import Array, Track
from mbot_workstation.measure.tracks.track_format import PRESETS, TrackFormat

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


HEADER = "time_s x_m y_m z_m qx qy qz qw"


def write_tum(path: Path, track: Track) -> None:
    """Write the whole track, or leave the file as it was; raises ConfigurationError."""
    table = np.column_stack(
        [track.time_s, track.position_m, np.roll(track.quaternion_wxyz, -1, axis=1)]
    )
    formats = ["%.6f", *["%.6f"] * 3, *["%.9f"] * 4]
    text = io.BytesIO()
    np.savetxt(text, table, fmt=formats, header=HEADER)
    atomic_file.save(path, text.getvalue())


FLUSH_EVERY_S = 0.5


class TrackFile:
    """Writes a new TUM file pose by pose; a context manager.

    Attributes:
        poses: written so far.

    """

    def __init__(self, path: Path) -> None:
        """Create the file.

        Raises:
            ConfigurationError: it exists already, or can't be written.

        """
        check_new(path)
        self.poses = 0
        self._path = path
        self._flushed_s = time.monotonic()
        try:
            self._file = path.open("x", encoding="utf-8")
        except OSError as error:
            raise ConfigurationError(f"can't write {path}: {error.strerror}") from None
        self._file.write(f"# {HEADER}\n")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def add(self, time_s: float, position_m: Array, quaternion_wxyz: Array) -> None:
        """Append a pose: z up, shapes (3,) and (4,).

        Raises:
            ConfigurationError: the disk is full or gone.

        """
        numbers = [*position_m, *np.roll(quaternion_wxyz, -1)]
        text = " ".join(f"{number:.6f}" for number in numbers)
        try:
            self._file.write(f"{time_s:.6f} {text}\n")
            if time.monotonic() - self._flushed_s > FLUSH_EVERY_S:
                self._file.flush()
                self._flushed_s = time.monotonic()
        except OSError as error:
            raise ConfigurationError(
                f"can't write {self._path}: {error.strerror}; what was saved can be read"
            ) from None
        self.poses += 1


def check_new(path: Path) -> None:
    """Find out before anything is recorded whether this file can be made; makes its folder.

    Raises:
        ConfigurationError: it exists, has another ending, or its folder can't be made.

    """
    if path.suffix not in (".tum", ".txt"):
        raise ConfigurationError(f"{path} ends in {path.suffix!r}, expected .tum: a TUM track")
    if path.exists():
        raise ConfigurationError(f"{path} exists already; choose another name")
    try:
        path.absolute().parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigurationError(f"can't make {path.parent}: {error.strerror}") from None
