"""Tracks as text: comma-separated values with or without a header, and TUM files."""

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.text_file import read_text
from mbot_workstation.recordings.raw_track import RawTrack
from mbot_workstation.recordings.track import Array
from mbot_workstation.recordings.track_format import Column, TrackFormat
from mbot_workstation.recordings.track_frame import from_euler

DELIMITERS = (",", ";", "\t")


@dataclass(frozen=True, slots=True)
class _Table:
    """A file's fields. `lines` are the numbers of the rows' lines, for messages."""

    path: Path
    header: tuple[str, ...]
    lines: Sequence[int]
    rows: Sequence[Sequence[str]]


def read_table(path: Path, form: TrackFormat) -> RawTrack:
    """The poses of a .csv, .tum or .txt file, units and quaternion order applied.

    Raises:
        ConfigurationError: the file is unusable; with line and column.

    """
    table = _table(path)
    time = _numbers(table, (form.time,))[:, 0]
    position = _numbers(table, form.position)
    if form.quaternion is not None:
        quaternion = _numbers(table, form.quaternion)
        if form.quaternion_order == "w-last":
            quaternion = np.roll(quaternion, 1, axis=1)
    else:
        angles = _numbers(table, form.euler or ())
        if form.euler_unit == "deg":
            angles = np.radians(angles)
        quaternion = from_euler(angles, form.euler_axes)
    places = tuple(f"line {line}" for line in table.lines)
    return RawTrack(path, places, time, position, quaternion)


def _table(path: Path) -> _Table:
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
    header: tuple[str, ...] = ()
    if not _is_number(rows[0][0]):
        header = tuple(name.strip().strip('"') for name in rows[0])
        lines, rows = lines[1:], rows[1:]
    return _Table(path, header, lines, rows)


def _split(lines: Sequence[str], path: Path) -> Sequence[Sequence[str]]:
    if path.suffix.lower() != ".csv":
        return [line.split() for line in lines]
    delimiter = max(DELIMITERS, key=lines[0].count)
    return list(csv.reader(lines, delimiter=delimiter, skipinitialspace=True))


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
    try:
        value = float(fields[index])
    except ValueError:
        raise ConfigurationError(
            f"{table.path}, line {line}: {column!r} is {fields[index]!r}, expected a number with a "
            "decimal point"
        ) from None
    if not math.isfinite(value):
        raise ConfigurationError(
            f"{table.path}, line {line}: {column!r} is {fields[index].strip()}; leave out the "
            "lines of moments the tracker had lost"
        )
    return value


def _index(table: _Table, column: Column) -> int:
    if isinstance(column, int):
        return column - 1
    if not table.header:
        raise ConfigurationError(
            f"{table.path} has no header, so there is no column {column!r}; give columns by number "
            "from 1 in track.toml"
        )
    if table.header.count(column) != 1:
        there = "twice or more" if column in table.header else "not"
        raise ConfigurationError(
            f"{table.path}: column {column!r} is {there} among {', '.join(table.header)}; name the "
            "columns in track.toml, see docs/recordings.md"
        )
    return table.header.index(column)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
