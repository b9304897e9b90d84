"""All that the page shows, worked out; nothing here knows HTML."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbot_workstation.calibration_files.calibration_folder import CalibrationFiles
from mbot_workstation.gap_report.compared_run import CALIBRATED, NOMINAL, ComparedRun
from mbot_workstation.gap_report.deviation import SPINS, STRAIGHT, deviation
from mbot_workstation.gap_report.frame_pair import FramePair
from mbot_workstation.gap_report.path_error import PathError, path_error
from mbot_workstation.gap_report.quantity import quantities
from mbot_workstation.gap_report.steady_rates import RunRates, steady_rates
from mbot_workstation.gap_report.verdict import Judged, judge
from mbot_workstation.identification.held_out import heading_share
from mbot_workstation.recordings.maneuver import MANEUVERS
from mbot_workstation.training.studies.tolerance_file import Tolerances


@dataclass(frozen=True, slots=True, eq=False)
class ManeuverGap:
    """One manoeuvre.

    Attributes:
        name: of the manoeuvre.
        runs: its held-out repetitions.
        calibrated, nominal: errors of the two simulated robots.

    """

    name: str
    runs: tuple[ComparedRun, ...]
    calibrated: PathError
    nominal: PathError


@dataclass(frozen=True, slots=True)
class Headline:
    """A simulated robot in a few numbers; a rate is None if no run is long enough for it.

    Attributes:
        position_m, yaw_rad: at the end of the drive: the middle one of all held-out runs.
        turned_share: the heading's error as a share of the angle turned, as `identify` tells it;
            None if no run turns once.
        worst_position_m, worst_yaw_rad: and the largest.
        speed: largest error of a manoeuvre's mean steady speed, of the speed straight on.
        turn: likewise of the turn rate, of that on the spot.

    """

    position_m: float
    yaw_rad: float
    worst_position_m: float
    worst_yaw_rad: float
    turned_share: float | None
    speed: float | None
    turn: float | None


@dataclass(frozen=True, slots=True)
class Missing:
    """Something the page can't show.

    Attributes:
        what: it is, with what is lost by it.
        command: that would make it.

    """

    what: str
    command: str


@dataclass(frozen=True, slots=True, eq=False)
class GapReport:
    """The whole report.

    Attributes:
        robot_id: whose.
        made_on: ISO date.
        recordings: folders.
        recorded_runs: in them, in all.
        held_out_words: which runs were held out.
        left_out: runs that could not be used, by name, and why.
        files: the calibration.
        maneuvers: those that were driven, in the usual order.
        rates: steady rates of all held-out runs.
        calibrated, nominal: headlines.
        judged: the quantities with their verdicts.
        tolerances: the maps they were held against.
        frames: pictures in pairs.
        frames_words: where they come from, or why there are none.
        missing: see `Missing`.

    """

    robot_id: str
    made_on: str
    recordings: tuple[str, ...]
    recorded_runs: int
    held_out_words: str
    left_out: dict[str, str]
    files: CalibrationFiles
    maneuvers: tuple[ManeuverGap, ...]
    rates: tuple[RunRates, ...]
    calibrated: Headline
    nominal: Headline
    judged: tuple[Judged, ...]
    tolerances: Tolerances | None
    frames: tuple[FramePair, ...]
    frames_words: str
    missing: tuple[Missing, ...]

    @property
    def held_out(self) -> int:
        """How many runs are shown."""
        return sum(len(one.runs) for one in self.maneuvers)

    @property
    def driven_s(self) -> float:
        """The longest time after which errors are given."""
        return max(float(one.calibrated.time_s[-1]) for one in self.maneuvers)

    @property
    def turned_rad(self) -> float:
        """How far the robot turned in a run, either way; the middle one of all shown."""
        runs = [run for one in self.maneuvers for run in one.runs]
        return float(np.median([abs(run.turned_rad) for run in runs]))


@dataclass(frozen=True, slots=True, eq=False)
class Driven:
    """What the figures of driving are worked out from.

    Attributes:
        maneuvers, rates, calibrated, nominal: as in `GapReport`.

    """

    maneuvers: tuple[ManeuverGap, ...]
    rates: tuple[RunRates, ...]
    calibrated: Headline
    nominal: Headline


def driven(runs: Sequence[ComparedRun]) -> Driven:
    """All figures of the held-out runs; there is at least one."""
    gaps: list[ManeuverGap] = []
    for maneuver in MANEUVERS:
        mine = tuple(run for run in runs if run.maneuver == maneuver.name)
        if mine:
            errors = [path_error(mine, path) for path in (CALIBRATED, NOMINAL)]
            gaps.append(ManeuverGap(maneuver.name, mine, *errors))
    rates = steady_rates(runs)
    return Driven(
        tuple(gaps),
        rates,
        _headline(gaps, rates, CALIBRATED),
        _headline(gaps, rates, NOMINAL),
    )


def judged(
    files: CalibrationFiles, rates: Sequence[RunRates], tolerances: Tolerances | None
) -> tuple[Judged, ...]:
    """Every quantity with its verdicts."""
    before, after = (deviation(rates, path) for path in (NOMINAL, CALIBRATED))
    return tuple(judge(one, tolerances) for one in quantities(files, before, after))


def _headline(gaps: Sequence[ManeuverGap], rates: Sequence[RunRates], path: str) -> Headline:
    errors: list[PathError] = [getattr(gap, path) for gap in gaps]
    runs = [run for gap in gaps for run in gap.runs]
    off = [(run.paths()[path][-1, 2] - run.measured[-1, 2], run.turned_rad) for run in runs]
    position_m = np.concatenate([error.position_at_end_m for error in errors])
    yaw_rad = np.concatenate([error.yaw_at_end_rad for error in errors])
    return Headline(
        position_m=float(np.median(position_m)),
        yaw_rad=float(np.median(yaw_rad)),
        worst_position_m=float(position_m.max()),
        worst_yaw_rad=float(yaw_rad.max()),
        turned_share=heading_share(off),
        speed=_largest(rates, path, "speed_mps", STRAIGHT),
        turn=_largest(rates, path, "turn_radps", SPINS),
    )


def _largest(rates: Sequence[RunRates], path: str, field: str, full: Sequence[str]) -> float | None:
    """Largest error of any manoeuvre's mean, as a share of the full speed or turn rate."""
    errors: dict[str, list[float]] = {}
    for one in rates:
        error = getattr(one.rate(path), field) - getattr(one.measured, field)
        errors.setdefault(one.maneuver, []).append(error)
    fulls = [abs(getattr(one.measured, field)) for one in rates if one.maneuver in full]
    if not fulls or not errors:
        return None
    return max(abs(float(np.mean(some))) for some in errors.values()) / float(np.mean(fulls))
