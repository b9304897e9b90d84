"""Tracks as text: comma-separated values with or without a header, and TUM files."""

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.files.text_file import read_text
from mbot_workstation.measure.tracks.raw_track import RawTrack, from_euler
from mbot_workstation.measure.tracks.track import Array
from mbot_workstation.measure.tracks.track_format import Column, TrackFormat

MOST_HEADER_LINES = 20
"""Vicon's have 5, Motive's 7, Qualisys' 11."""

DELIMITERS = (",", ";", "\t")


@dataclass(frozen=True, slots=True)
class _Table:
    """A file's fields. `lines` are the numbers of the rows' lines, for messages.

    Where a header has several lines, names may be in any of them: `header` has the line and the
    fields of the one that has most of those wanted.
    """

    path: Path
    header: tuple[int, tuple[str, ...]] | None
    lines: Sequence[int]
    rows: Sequence[Sequence[str]]


def read_table(path: Path, form: TrackFormat) -> RawTrack:
    """The poses of a .csv, .tum or .txt file, units and quaternion order applied.

    Raises:
        ConfigurationError: the file is unusable; with line and column.

    """
    table = _table(path, form)
    time = _numbers(table, (form.time,))[:, 0]
    position = _numbers(table, form.position)
    if len(form.position) == 2:
        position = np.column_stack([position, np.zeros(len(position))])
    if form.quaternion is not None:
        quaternion = _numbers(table, form.quaternion)
        if form.quaternion_order == "w-last":
            quaternion = np.roll(quaternion, 1, axis=1)
    else:
        angles = _numbers(table, form.rotation_vector or form.euler or ())
        if form.euler_unit == "deg":
            angles = np.radians(angles)
        quaternion = _attitudes(angles, form)
    places = tuple(f"line {line}" for line in table.lines)
    return RawTrack(path, places, time, position, quaternion)


def _attitudes(angles: Array, form: TrackFormat) -> Array:
    """Quaternions, w first; of lost poses again no numbers."""
    quaternion = np.full((len(angles), 4), np.nan)
    known = np.isfinite(angles).all(axis=1)
    if known.any() and form.rotation_vector is not None:
        turns = Rotation.from_rotvec(angles[known])
        quaternion[known] = turns.as_quat(scalar_first=True)
    elif known.any():
        quaternion[known] = from_euler(angles[known], form.euler_axes)
    return quaternion


def _table(path: Path, form: TrackFormat) -> _Table:
    text = read_text(path)
    numbered = [
        (number, line)
        for number, line in enumerate(text.splitlines(), start=1)
        if line.strip() and not line.startswith("#")
    ]
    if not numbered:
        raise ConfigurationError(f"{path} is empty")
    lines = [number for number, _line in numbered]
    rows = _split([line for _number, line in numbered], path)
    size = _header_lines(rows)
    attitude = form.quaternion or form.rotation_vector or form.euler or ()
    wanted = {name for name in (form.time, *form.position, *attitude) if isinstance(name, str)}
    named = [tuple(name.strip().strip('"') for name in row) for row in rows[:size]]
    headers = list(zip(lines, named, strict=False))
    header = max(headers, key=lambda one: len(wanted & {*one[1]}), default=None)
    return _Table(path, header, lines[size:], rows[size:])


def _header_lines(rows: Sequence[Sequence[str]]) -> int:
    """How many lines are before the numbers; the last of them holds words only."""
    words_only = [
        number
        for number, row in enumerate(rows[:MOST_HEADER_LINES], start=1)
        if any(row) and not any(_is_number(field) for field in row)
    ]
    return max(words_only, default=int(not _is_number(rows[0][0])))


def _split(lines: Sequence[str], path: Path) -> Sequence[Sequence[str]]:
    if path.suffix.lower() != ".csv":
        return [line.split() for line in lines]
    first = next((line for line in lines if any(one in line for one in DELIMITERS)), "")
    delimiter = max(DELIMITERS, key=first.count)
    try:
        return list(csv.reader(lines, delimiter=delimiter, skipinitialspace=True))
    except csv.Error as error:  # a cell longer than any number
        raise ConfigurationError(f"the track is no table: {error}") from None


def _numbers(table: _Table, columns: Sequence[Column]) -> Array:
    """Shape (rows, columns)."""
    indices = [_index(table, column) for column in columns]
    values = np.empty((len(table.rows), len(columns)))
    for row, (line, fields) in enumerate(zip(table.lines, table.rows, strict=True)):
        for place, index in enumerate(indices):
            values[row, place] = _number(table, line, fields, index, columns[place])
    return values


def _number(table: _Table, line: int, fields: Sequence[str], index: int, column: Column) -> float:
    if index >= len(fields):
        raise ConfigurationError(
            f"{table.path}, line {line}: {len(fields)} fields, so there is no column {column!r}; "
            "was the file cut off?"
        )
    if not fields[index].strip():
        return math.nan  # as many write what they had lost
    try:
        return float(fields[index])
    except ValueError:
        raise ConfigurationError(
            f"{table.path}, line {line}: {column!r} is {fields[index]!r}, expected a number with a "
            "decimal point"
        ) from None


def _index(table: _Table, column: Column) -> int:
    if isinstance(column, int):
        return column - 1
    if table.header is None:
        raise ConfigurationError(
            f"{table.path} has no header, so there is no column {column!r}; give columns by number "
            "from 1 in track.toml"
        )
    line, names = table.header
    if names.count(column) != 1:
        there = "twice or more" if column in names else "not"
        raise ConfigurationError(
            f"{table.path}, line {line}: column {column!r} is {there} among {', '.join(names)}; "
            "give the columns in track.toml by name or by number, see docs/recordings.md"
        )
    return names.index(column)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
