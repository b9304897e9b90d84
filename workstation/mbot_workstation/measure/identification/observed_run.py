"""A run as increments: how far the tracker went and turned, in its own frame, bin after bin.

Increments know nothing of where a run began, nor of the world's axes, and what the robot did an
hour or a metre ago is not in them. The simulated run is averaged over the very same samples, so
that bins need not be short.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbot_workstation.measure.identification.floor import FlatRun, Plane
from mbot_workstation.measure.tracks.track import Array

BIN_S = 0.1
"""About a time constant; nine samples at 90 Hz."""

BEFORE_S = 0.5
"""Of standing before the first command. What comes after the last one is not looked at: whether
motors brake or roll out is another question than how they drive."""

STARTING_S = 0.6
"""After a change of command: even a motor of 200 ms has 95 % of its speed."""

GUESS_S = 0.1
"""How well the clocks are known at first; so much is left out before the last command."""


@dataclass(frozen=True, slots=True, eq=False)
class Bins:
    """Averages over short bins of samples.

    Attributes:
        first: index of each bin's first sample, shape (bins,).
        count: samples in each, shape (bins,).
        time_s: mean of each, shape (bins,).

    """

    first: NDArray[np.intp]
    count: NDArray[np.intp]
    time_s: Array

    def increments(self, place: Plane, heading: Array) -> Array:
        """From bin to bin: ahead [m], to the left [m], turned to the left [rad].

        Args:
            place, heading: of each sample, shape (..., n).

        Returns:
            Shape (..., 3, bins - 1). Ahead is where the tracker's x points half-way.

        """
        points = np.add.reduceat(place, self.first, axis=-1) / self.count
        angles = np.add.reduceat(heading, self.first, axis=-1) / self.count
        step = np.diff(points) * np.exp(-0.5j * (angles[..., 1:] + angles[..., :-1]))
        return np.stack([step.real, step.imag, np.diff(angles)], axis=-2)


def bins_of(time_s: Array) -> Bins:
    """Sort rising times, shape (n,), into bins."""
    _, first = np.unique(np.floor(time_s / BIN_S), return_index=True)
    count = np.diff(first, append=time_s.size)
    return Bins(first, count, np.add.reduceat(time_s, first) / count)


@dataclass(frozen=True, slots=True, eq=False)
class ObservedRun:
    """One run, ready to be compared.

    Attributes:
        flat: the run.
        ahead_s: first guess of the tracker's clock minus the robot's, the wheels' delay included.
        own_clock: whether no other run shares this clock.
        since_middle_s: when it began, from the recording's middle; for the clocks' drift.
        since_others_s: when it began, from the middle of the maneuver's other runs; for the
            battery's: from one maneuver to the next, nobody can tell it from the model's faults.
        sample_s: of the samples that are used, since the first command by `ahead_s`, shape (n,).
        place, heading: of the tracker in these samples, shape (n,).
        bins: of these samples.
        seen: increments, shape (3, bins - 1).

    """

    flat: FlatRun
    ahead_s: float
    own_clock: bool
    since_middle_s: float
    since_others_s: float
    sample_s: Array
    place: Plane
    heading: Array
    bins: Bins
    seen: Array

    @property
    def maneuver(self) -> str:
        """Its name."""
        return self.flat.run.maneuver

    @property
    def drive_s(self) -> float:
        """From the first command to the last."""
        return self.flat.run.commands.end_s - self.flat.run.commands.start_s

    @property
    def covered_s(self) -> float:
        """How much of its driving the samples cover."""
        if self.sample_s.size == 0:
            return 0.0
        return float(self.sample_s[-1] - max(self.sample_s[0], 0.0))


def observe(
    flat: FlatRun, ahead_s: float, middles_s: tuple[float, float], *, own_clock: bool
) -> ObservedRun:
    """Cut the driving out of a run.

    Args:
        flat: the run.
        ahead_s: the tracker's clock minus the robot's, to about GUESS_S.
        middles_s: of the recording, and of this maneuver's runs in it, on the robot's clock.
        own_clock: whether no other run shares the tracker's clock.

    """
    commands = flat.run.commands
    since = flat.time_s - ahead_s - commands.start_s
    used = (since >= -BEFORE_S) & (since <= commands.end_s - commands.start_s - GUESS_S)
    sample_s, place, heading = since[used], flat.place[used], flat.heading[used]
    bins = bins_of(sample_s) if sample_s.size else Bins(_NONE, _NONE, sample_s)
    seen = bins.increments(place, heading) if sample_s.size else np.zeros((3, 0))
    since_s = (commands.start_s - middles_s[0], commands.start_s - middles_s[1])
    return ObservedRun(flat, ahead_s, own_clock, *since_s, sample_s, place, heading, bins, seen)


_NONE = np.zeros(0, np.intp)


def driving(run: ObservedRun) -> list[tuple[float, float, NDArray[np.bool_]]]:
    """Left and right command of each held stretch, and the increments of its steady driving.

    Masks have shape (bins - 1,); they begin STARTING_S after a change of command.
    """
    commands = run.flat.run.commands
    begin, end = run.bins.time_s[:-1], run.bins.time_s[1:]
    changes = np.flatnonzero(
        np.diff(commands.left, prepend=np.nan) + 1j * np.diff(commands.right, prepend=np.nan) != 0
    )
    ends_s = np.append(commands.time_s[changes[1:]], np.inf) - commands.start_s
    stretches: list[tuple[float, float, NDArray[np.bool_]]] = []
    for row, end_s in zip(changes, ends_s, strict=True):
        since = commands.time_s[row] - commands.start_s + STARTING_S
        told = float(commands.left[row]), float(commands.right[row])
        chosen = (begin >= since) & (end <= end_s - GUESS_S)
        if told != (0.0, 0.0) and chosen.any():
            stretches.append((*told, chosen))
    return stretches


def maneuvers(runs: Sequence[ObservedRun]) -> dict[str, list[int]]:
    """The indices of each maneuver's runs."""
    result: dict[str, list[int]] = {}
    for index, run in enumerate(runs):
        result.setdefault(run.maneuver, []).append(index)
    return result
