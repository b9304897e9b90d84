"""`commands.csv`: what the robot was told in each run, a row at every change."""

import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mbot_protocol.errors import ConfigurationError
from mbot_protocol.files import atomic_file
from mbot_protocol.files.text_file import read_text
from mbot_workstation.measure.tracks.maneuver import Maneuver, maneuver_named
from mbot_workstation.measure.tracks.run import CommandSeries

HEADER = ("run", "maneuver", "repetition", "time_s", "left", "right")


@dataclass(frozen=True, slots=True, eq=False)
class CommandedRun:
    """A run without its track; fields as in `Run`."""

    number: int
    maneuver: str
    repetition: int
    commands: CommandSeries


@dataclass(frozen=True, slots=True)
class _Row:
    line: int
    run: int
    maneuver: str
    repetition: int
    time_s: float
    left: float
    right: float


def read_commands(path: Path, *, may_be_empty: bool = False) -> tuple[CommandedRun, ...]:
    """All runs, in the order of their first rows.

    Raises:
        ConfigurationError: the file is missing, unusable (with the line), or without any run.

    """
    rows_of: dict[int, list[_Row]] = {}
    for row in _rows(path):
        rows_of.setdefault(row.run, []).append(row)
    if not rows_of and not may_be_empty:
        raise ConfigurationError(f"{path} holds no run; record some with `workstation maneuvers`")
    return tuple(_run(path, rows) for rows in rows_of.values())


def write_commands(path: Path, runs: Iterable[CommandedRun]) -> None:
    """Rewrite the file, whole or not at all; raises OSError."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(HEADER)
    for run in runs:
        series = run.commands
        for time_s, left, right in zip(series.time_s, series.left, series.right, strict=True):
            numbers = (f"{time_s:.6f}", f"{left:g}", f"{right:g}")
            writer.writerow((run.number, run.maneuver, run.repetition, *numbers))
    atomic_file.replace(path, text.getvalue().encode())


def _rows(path: Path) -> Iterable[_Row]:
    lines = read_text(path).splitlines()
    if max(map(len, lines), default=0) > csv.field_size_limit():
        raise ConfigurationError(f"{path} is no table of commands: a line has no end")
    reader = csv.reader(lines)
    header = tuple(name.strip() for name in next(reader, []))
    if header != HEADER:
        raise ConfigurationError(
            f"{path} begins with {','.join(header)!r}, expected the header {','.join(HEADER)!r}"
        )
    for fields in reader:
        if fields:
            yield _row(path, reader.line_num, fields)


def _row(path: Path, line: int, fields: Sequence[str]) -> _Row:
    if len(fields) != len(HEADER):
        raise ConfigurationError(
            f"{path}, line {line}: {len(fields)} fields, expected {len(HEADER)}"
        )
    run, maneuver, repetition, *numbers = (field.strip() for field in fields)
    try:
        time_s, left, right = (float(number) for number in numbers)
        return _Row(line, int(run), maneuver, int(repetition), time_s, left, right)
    except ValueError:
        raise ConfigurationError(
            f"{path}, line {line}: {','.join(fields)!r} should be whole numbers for run and "
            "repetition and numbers for time_s, left and right"
        ) from None


def _run(path: Path, rows: Sequence[_Row]) -> CommandedRun:
    first = rows[0]
    where = f"{path}, run {first.run} from line {first.line}"
    maneuver = _maneuver_named(where, first.maneuver)
    for row in rows:
        if (row.maneuver, row.repetition) != (first.maneuver, first.repetition):
            raise ConfigurationError(
                f"{path}, line {row.line}: run {row.run} is {row.maneuver} {row.repetition} here "
                f"and {first.maneuver} {first.repetition} in line {first.line}; each run needs a "
                "number of its own"
            )
        if not _may_be_told(maneuver, row.left, row.right):
            expected = (
                f"one wheel at a time, at most {maneuver.left:g}"
                if maneuver.is_slow
                else f"{maneuver.left:g}, {maneuver.right:g} or 0, 0"
            )
            raise ConfigurationError(
                f"{path}, line {row.line}: left, right are {row.left:g}, {row.right:g} in a "
                f"{row.maneuver} run, expected {expected}"
            )
    columns = ([row.time_s for row in rows], [row.left for row in rows], [r.right for r in rows])
    try:
        series = CommandSeries(*(np.array(column, dtype=np.float64) for column in columns))
    except ValueError as error:
        raise ConfigurationError(f"{where}: {error}") from None
    return CommandedRun(first.run, first.maneuver, first.repetition, series)


def _may_be_told(maneuver: Maneuver, left: float, right: float) -> bool:
    if maneuver.is_slow:
        return left * right == 0 and max(abs(left), abs(right)) <= maneuver.left
    return (left, right) in ((0.0, 0.0), (maneuver.left, maneuver.right))


def _maneuver_named(where: str, name: str) -> Maneuver:
    try:
        return maneuver_named(name)
    except ConfigurationError as error:
        raise ConfigurationError(f"{where}: {error}") from None
