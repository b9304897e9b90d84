"""Paths, errors over time and steady rates."""

import math
from collections.abc import Sequence

import numpy as np

from mbot_workstation.gap_report.elements import figure, paragraph, table
from mbot_workstation.gap_report.error_plot import error_plot
from mbot_workstation.gap_report.number_words import degrees, metres, seconds
from mbot_workstation.gap_report.path_plot import path_plot
from mbot_workstation.gap_report.rates_plot import rates_plot
from mbot_workstation.gap_report.report import GapReport, ManeuverGap
from mbot_workstation.gap_report.steady_rates import SETTLED_S, RunRates

KEY = (
    '<div class="key"><span class="measured"><i></i>measured</span>'
    '<span class="calibrated"><i></i>simulated with the calibration</span>'
    '<span class="nominal"><i></i>nominal simulation</span></div>'
)


def driving_section(report: GapReport) -> str:
    """HTML."""
    left_out = report.left_out
    return "".join(
        [
            "<h2>Paths</h2>",
            paragraph(
                f"From above; the robot starts at the dot, facing up. {report.held_out_words} "
                "Manoeuvres are named left motor-right motor.",
                "soft",
            ),
            *(paragraph(f"Left out: {name}: {why}.", "soft") for name, why in left_out.items()),
            KEY,
            f'<div class="charts">{"".join(_path(one) for one in report.maneuvers)}</div>',
            "<h2>Errors over time</h2>",
            paragraph(
                "Distance and angle between the simulated and the measured robot on the same "
                "commands. Lines are medians, bands reach over all held-out repetitions; note the "
                "logarithmic scale. The start of each path is taken from the robot's standing "
                "before it; the tracker's own noise, some millimetres, is part of every error.",
                "soft",
            ),
            KEY,
            f'<div class="charts">{"".join(_errors(one) for one in report.maneuvers)}</div>',
            _end_table(report),
            "<h2>Steady speeds and turn rates</h2>",
            _rates(report),
        ]
    )


def _path(one: ManeuverGap) -> str:
    count = f"{len(one.runs)} repetitions" if len(one.runs) > 1 else "1 repetition"
    return figure(path_plot(one.name, one.runs), count, one.name)


def _errors(one: ManeuverGap) -> str:
    return figure(error_plot(one.name, one.calibrated, one.nominal), "", one.name)


def _end_table(report: GapReport) -> str:
    header = ["at the end", "after", "position", "nominal", "heading", "nominal"]
    rows = [
        [
            one.name,
            seconds(float(one.calibrated.time_s[-1])),
            metres(float(np.median(one.calibrated.position_at_end_m))),
            metres(float(np.median(one.nominal.position_at_end_m))),
            degrees(float(np.median(one.calibrated.yaw_at_end_rad))),
            degrees(float(np.median(one.nominal.yaw_at_end_rad))),
        ]
        for one in report.maneuvers
    ]
    return table(header, rows, numbers=5)


def _rates(report: GapReport) -> str:
    if not report.rates:
        return paragraph(
            f"No run is long enough: the first {SETTLED_S:g} s go to picking up speed. Record "
            "longer ones with `workstation maneuvers run --seconds 10`.",
            "soft",
        )
    names = [one.name for one in report.maneuvers]
    rows = [_rate_row(name, [r for r in report.rates if r.maneuver == name]) for name in names]
    return "".join(
        [
            paragraph(
                f"From {SETTLED_S:g} s on. The tick is what was measured, the bar below it reaches "
                "over all repetitions.",
                "soft",
            ),
            figure(rates_plot(names, report.rates), ""),
            table(
                [
                    *("manoeuvre", "speed, m/s", "simulated", "nominal"),
                    *("turn rate, °/s", "simulated", "nominal"),
                ],
                [row for row in rows if row],
                numbers=6,
            ),
        ]
    )


def _rate_row(name: str, rates: Sequence[RunRates]) -> list[str]:
    if not rates:
        return []
    paths = ("measured", "calibrated", "nominal")
    speeds = [float(np.mean([one.rate(path).speed_mps for one in rates])) for path in paths]
    turns = [float(np.mean([one.rate(path).turn_radps for one in rates])) for path in paths]
    return [
        name,
        *(f"{speed:+.4f}" for speed in speeds),
        *(f"{math.degrees(turn):+.2f}" for turn in turns),
    ]
