"""What driving says in numbers: errors over time, headlines, and where nothing was gained."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mbot_workstation.measure.gap_report.compare import (
    CALIBRATED,
    MEASURED,
    NOMINAL,
    ComparedRun,
    Rate,
)
from mbot_workstation.measure.identification.validation import heading_share
from mbot_workstation.measure.tracks.maneuver import MANEUVERS
from mbot_workstation.measure.tracks.track import Array

STEP_S = 0.05
"""Between the moments at which errors are given."""

STRAIGHT = ("forward-forward", "backward-backward")
SPINS = ("forward-backward", "backward-forward")

NOISE = {"position": 0.005, "heading": 0.009}
"""Metres and radians that tracks leave in an error: what is worse by less is not worse."""


@dataclass(frozen=True, slots=True, eq=False)
class PathError:
    """Simulated against measured, of one maneuver by one simulated robot.

    Attributes:
        time_s: shape (n,); as long as the shortest repetition.
        position_m: distance between the two places, never negative; shape (repetitions, n).
        yaw_rad: difference of the two headings, never negative; more than a turn is possible.

    """

    time_s: Array
    position_m: Array
    yaw_rad: Array


@dataclass(frozen=True, slots=True)
class Headline:
    """A simulated robot in a few numbers.

    Attributes:
        position_m, yaw_deg: at the end of the drive: the middle one of all held-out runs.
        worst_position_m, worst_yaw_deg: and the largest.
        turned_share: the heading's error as a share of the angle turned, as `identify` tells it;
            None if no run turns once.
        speed_share: largest error of a maneuver's mean steady speed, of the speed straight on;
            None if no run is long enough.
        turn_share: likewise of the turn rate, of that on the spot.

    """

    position_m: float
    yaw_deg: float
    worst_position_m: float
    worst_yaw_deg: float
    turned_share: float | None
    speed_share: float | None
    turn_share: float | None


@dataclass(frozen=True, slots=True, eq=False)
class Driving:
    """All figures of the runs shown, which are named by what was driven, in the usual order."""

    maneuvers: Mapping[str, tuple[ComparedRun, ...]]
    calibrated: Headline
    nominal: Headline

    @property
    def runs(self) -> tuple[ComparedRun, ...]:
        """All that are shown."""
        return tuple(run for runs in self.maneuvers.values() for run in runs)

    @property
    def driven_s(self) -> float:
        """The longest time after which errors are given."""
        return max(float(path_error(r, NOMINAL).time_s[-1]) for r in self.maneuvers.values())

    @property
    def turned_rad(self) -> float:
        """How far the robot turned in a run, either way; the middle one of all shown."""
        return float(np.median([abs(run.turned_rad) for run in self.runs]))

    @property
    def not_helped(self) -> tuple[str, ...]:
        """Where the calibrated simulation is further off at the end than the nominal one."""
        found: list[str] = []
        for name, runs in self.maneuvers.items():
            after, before = (at_end(path_error(runs, path)) for path in (CALIBRATED, NOMINAL))
            ends = zip(NOISE.items(), after, before, strict=True)
            worse = [what for (what, noise), new, old in ends if new > old + noise]
            found += [f"the {' and '.join(worse)} of {name}"] if worse else []
        return tuple(found)


def driving(runs: Sequence[ComparedRun]) -> Driving:
    """All figures of held-out runs; there is at least one."""
    maneuvers = {
        one.name: mine
        for one in MANEUVERS
        if (mine := tuple(run for run in runs if run.maneuver == one.name))
    }
    return Driving(maneuvers, _headline(maneuvers, CALIBRATED), _headline(maneuvers, NOMINAL))


def path_error(runs: Sequence[ComparedRun], simulated: str) -> PathError:
    """Of all repetitions of one maneuver; at least one.

    Args:
        runs: the repetitions.
        simulated: "calibrated" or "nominal".

    """
    time_s = np.arange(0, min(run.time_s[-1] for run in runs) + STEP_S / 2, STEP_S)
    rows = [
        [np.interp(time_s, run.time_s, values) for values in (np.hypot(x, y), np.abs(yaw))]
        for run in runs
        for x, y, yaw in (run.off(simulated).T,)
    ]
    return PathError(time_s, *np.array(rows).swapaxes(0, 1))


def at_end(error: PathError) -> tuple[float, float]:
    """The middle repetition's position [m] and heading [rad] at the end."""
    return float(np.median(error.position_m[:, -1])), float(np.median(error.yaw_rad[:, -1]))


def _headline(maneuvers: Mapping[str, Sequence[ComparedRun]], path: str) -> Headline:
    runs = [run for some in maneuvers.values() for run in some]
    errors = [path_error(some, path) for some in maneuvers.values()]
    position_m = np.concatenate([error.position_m[:, -1] for error in errors])
    yaw_deg = np.degrees(np.concatenate([error.yaw_rad[:, -1] for error in errors]))
    return Headline(
        *(float(np.median(position_m)), float(np.median(yaw_deg))),
        *(float(position_m.max()), float(yaw_deg.max())),
        heading_share([(float(run.off(path)[-1, 2]), run.turned_rad) for run in runs]),
        _largest(maneuvers, path, lambda rate: rate.speed_mps, STRAIGHT),
        _largest(maneuvers, path, lambda rate: rate.turn_radps, SPINS),
    )


def _largest(
    maneuvers: Mapping[str, Sequence[ComparedRun]],
    path: str,
    pick: Callable[[Rate], float],
    full: Sequence[str],
) -> float | None:
    """Largest error of any maneuver's mean, as a share of the full speed or turn rate."""
    off: list[float] = []
    fulls: list[float] = []
    for name, runs in maneuvers.items():
        real, drawn = (
            [pick(run.rate(one)) for run in runs if run.is_steady] for one in (MEASURED, path)
        )
        off += [abs(float(np.mean(drawn) - np.mean(real)))] if real else []
        fulls += [abs(value) for value in real if name in full]
    return max(off) / float(np.mean(fulls)) if fulls else None
