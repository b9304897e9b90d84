"""The report for programs: everything but paths and pictures."""

from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from mbot_workstation.measure.gap_report.compare import CALIBRATED, NOMINAL, ComparedRun, Rate
from mbot_workstation.measure.gap_report.figures import Headline, path_error
from mbot_workstation.measure.gap_report.report import GapReport, Missing
from mbot_workstation.measure.gap_report.verdict import JudgedQuantity, ToleranceVerdict


class EndErrors(Struct, frozen=True):
    """How far a simulated robot ends from the measured one, of each repetition."""

    at_s: float
    position_m: list[float]
    yaw_deg: list[float]


class RunRates(Struct, frozen=True):
    """Steady driving in one run, as it was measured and as it is simulated."""

    maneuver: str
    measured: Rate
    calibrated: Rate
    nominal: Rate


class ManeuverAnswer(Struct, frozen=True):
    """The held-out runs of one maneuver; rates only of those that are long enough."""

    repetitions: list[int]
    calibrated: EndErrors
    nominal: EndErrors
    rates: list[RunRates]


class CardErrors(Struct, frozen=True):
    """The gray card's difference of colour, before and after its calibration."""

    before: float
    after: float


class VerdictAnswer(Struct, frozen=True):
    """A quantity, what of it the policy bears, and both verdicts."""

    quantity: str
    deviation: str
    tolerated: tuple[float, float] | None
    uncalibrated: ToleranceVerdict
    calibrated: ToleranceVerdict
    source: str


class GapAnswer(Struct, frozen=True):
    """The report. Radians where no name says degrees; None for what is not measured."""

    robot_id: str
    made_on: str
    recordings: tuple[str, ...]
    recorded_runs: int
    held_out_runs: int
    left_out: dict[str, str]
    after_s: float
    turned_deg: float
    calibrated: Headline
    nominal: Headline
    not_helped: tuple[str, ...]
    maneuvers: dict[str, ManeuverAnswer]
    reprojection_error_px: float | None
    gray_card_delta_e: CardErrors | None
    verdicts: list[VerdictAnswer]
    frames: int
    missing: tuple[Missing, ...]
    path: str


def gap_answer(report: GapReport, path: str) -> GapAnswer:
    """What a report says, and where its page is."""
    camera, light, driven = report.files.camera, report.files.light, report.driving
    return GapAnswer(
        robot_id=report.robot_id,
        made_on=report.made_on,
        recordings=report.recordings,
        recorded_runs=report.recorded_runs,
        held_out_runs=len(driven.runs),
        left_out={name: one.why for name, one in report.excluded.items()},
        after_s=round(driven.driven_s, 3),
        turned_deg=float(np.degrees(driven.turned_rad)),
        calibrated=driven.calibrated,
        nominal=driven.nominal,
        not_helped=driven.not_helped,
        maneuvers={name: _maneuver(name, runs) for name, runs in driven.maneuvers.items()},
        reprojection_error_px=camera and camera.reprojection_error_px,
        gray_card_delta_e=light and CardErrors(light.delta_e_before, light.delta_e_after),
        verdicts=[_verdict(one) for one in report.judged],
        frames=len(report.frames),
        missing=report.missing,
        path=path,
    )


def _verdict(one: JudgedQuantity) -> VerdictAnswer:
    known, ends = one.quantity, one.tolerated and (one.tolerated.low, one.tolerated.high)
    verdicts = one.uncalibrated, one.calibrated
    return VerdictAnswer(known.title, known.deviation, ends, *verdicts, known.source)


def _maneuver(name: str, runs: Sequence[ComparedRun]) -> ManeuverAnswer:
    calibrated, nominal = (_at_end(runs, path) for path in (CALIBRATED, NOMINAL))
    rates = [
        RunRates(name, *(run.rate(path) for path in RunRates.__struct_fields__[1:]))
        for run in runs
        if run.is_steady
    ]
    return ManeuverAnswer([run.repetition for run in runs], calibrated, nominal, rates)


def _at_end(runs: Sequence[ComparedRun], path: str) -> EndErrors:
    error = path_error(runs, path)
    position_m, yaw_deg = error.position_m[:, -1], np.degrees(error.yaw_rad[:, -1])
    return EndErrors(float(error.time_s[-1]), position_m.tolist(), yaw_deg.tolist())
