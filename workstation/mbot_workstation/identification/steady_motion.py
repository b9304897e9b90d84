"""What a run shows without any model: when it began to move, how fast it drove and turned."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbot_workstation.identification.flat_track import FlatRun
from mbot_workstation.recordings.run import CommandSeries
from mbot_workstation.recordings.track import Array

MOVED_M, TURNED_RAD = 0.02, 0.07
"""Beyond any noise of a resting tracker: 5 standard deviations of position, 13 of attitude."""

STARTING_S = 0.6
"""Left out after a change of command: even a motor of 200 ms has 95 % of its speed."""

SHORTEST_S = 0.8
"""Of steady driving, to say a speed."""


@dataclass(frozen=True, slots=True)
class SteadyPiece:
    """A stretch of one command, driven at its steady speed.

    Attributes:
        left, right: the actions.
        velocity: of the tracker in its own frame [m/s], x + iy.
        turn_rate: [rad/s], positive to the left.
        mirrored: whether the place turns the other way than the attitude.

    """

    left: float
    right: float
    velocity: complex
    turn_rate: float
    mirrored: bool


def onset_s(run: FlatRun) -> float | None:
    """When the robot began to move, on the tracker's clock; None if the track begins too late."""
    first = run.time_s < run.time_s[0] + 0.25
    rest_place, rest_heading = np.median(run.place[first]), np.median(run.heading[first])
    # A median of five is blind to single outliers.
    away = _median_of_five(np.abs(run.place - rest_place))
    turned = _median_of_five(np.abs(run.heading - rest_heading))
    moving = (away > MOVED_M) | (turned > TURNED_RAD)
    if not moving.any():
        return None
    begin = run.time_s[int(np.argmax(moving))]
    return None if begin < run.time_s[0] + 0.3 else float(begin)


def steady_pieces(run: FlatRun, ahead_s: float) -> list[SteadyPiece]:
    """The steady stretches of a run.

    Args:
        run: the run.
        ahead_s: the tracker's clock minus the robot's, to about 0.2 s.

    """
    return [
        piece
        for begin_s, end_s, left, right in held_commands(run.run.commands)
        if (left, right) != (0, 0)
        and (
            piece := _steady(
                run, begin_s + STARTING_S + ahead_s, end_s + ahead_s - 0.2, left, right
            )
        )
    ]


def held_commands(commands: CommandSeries) -> Sequence[tuple[float, float, float, float]]:
    """Begin, end, left, right of each row, on the robot's clock; equal neighbours are joined."""
    rows: list[tuple[float, float, float, float]] = []
    table = zip(commands.time_s, commands.time_s[1:], commands.left, commands.right, strict=False)
    for begin_s, end_s, left, right in table:
        if rows and rows[-1][2:] == (left, right):
            rows[-1] = (rows[-1][0], float(end_s), left, right)
        else:
            rows.append((float(begin_s), float(end_s), float(left), float(right)))
    return rows


def _steady(
    run: FlatRun, begin_s: float, end_s: float, left: float, right: float
) -> SteadyPiece | None:
    chosen = (run.time_s >= begin_s) & (run.time_s <= end_s)
    if np.count_nonzero(chosen) < 15 or np.ptp(run.time_s[chosen]) < SHORTEST_S:
        return None
    time_s = run.time_s[chosen] - run.time_s[chosen][0]
    line = _robust_fit(np.column_stack([np.ones_like(time_s), time_s]), run.heading[chosen])
    turn_rate = float(line[1].real)
    fits = []
    for sense in (1, -1):  # of the place, against that of the attitude
        way = np.exp(1j * sense * (line[0].real + turn_rate * time_s))
        path = np.append(0, np.cumsum((way[1:] + way[:-1]) / 2 * np.diff(time_s)))
        columns = np.column_stack([np.ones_like(path), path])
        found = _robust_fit(columns, run.place[chosen])
        off = float(np.median(np.abs(run.place[chosen] - columns @ found)))
        fits.append((found[1], off))
    (velocity, off), (_, mirrored_off) = fits
    return SteadyPiece(left, right, complex(velocity), turn_rate, mirrored_off < 0.5 * off)


def _median_of_five(values: Array) -> Array:
    padded = np.pad(values, 2, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 5)
    return np.asarray(np.median(windows, axis=1), np.float64)


def _robust_fit(columns: NDArray[Any], values: NDArray[Any]) -> NDArray[Any]:
    """Least squares in which far points lose their weight. Real or complex."""
    weight = np.ones(len(values))
    found = np.zeros(columns.shape[1])
    for _ in range(6):
        found, *_ = np.linalg.lstsq(columns * weight[:, None], values * weight, rcond=None)
        off = np.abs(values - columns @ found)
        weight = np.sqrt(1 / np.maximum(1, off / max(2 * float(np.median(off)), 1e-9)))
    return found
