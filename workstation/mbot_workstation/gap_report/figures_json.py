"""The report's figures for programs."""

from dataclasses import asdict
from typing import Any

import numpy as np

from mbot_workstation.gap_report.path_error import PathError
from mbot_workstation.gap_report.report import GapReport, Headline
from mbot_workstation.gap_report.verdict import Judged, Verdict


def figures(report: GapReport) -> dict[str, Any]:
    """Everything but paths and pictures. Angles in degrees where the name says so, else radians."""
    camera, light = report.files.camera, report.files.light
    return {
        "robot_id": report.robot_id,
        "made_on": report.made_on,
        "recordings": list(report.recordings),
        "recorded_runs": report.recorded_runs,
        "held_out_runs": report.held_out,
        "after_s": round(report.driven_s, 3),
        "turned_deg": float(np.degrees(report.turned_rad)),
        "calibrated": _headline(report.calibrated),
        "nominal": _headline(report.nominal),
        "maneuvers": {
            one.name: {
                "repetitions": [run.repetition for run in one.runs],
                "calibrated": _error(one.calibrated),
                "nominal": _error(one.nominal),
                "rates": [asdict(rate) for rate in report.rates if rate.maneuver == one.name],
            }
            for one in report.maneuvers
        },
        "reprojection_error_px": None if camera is None else camera.reprojection_error_px,
        "gray_card_delta_e": None
        if light is None
        else {"before": light.delta_e_before, "after": light.delta_e_after},
        "verdicts": [_judged(one) for one in report.judged],
        "frames": len(report.frames),
        "missing": [asdict(one) for one in report.missing],
    }


def _headline(one: Headline) -> dict[str, float | None]:
    return {
        "position_m": one.position_m,
        "yaw_deg": float(np.degrees(one.yaw_rad)),
        "worst_position_m": one.worst_position_m,
        "worst_yaw_deg": float(np.degrees(one.worst_yaw_rad)),
        "turned_share": one.turned_share,
        "speed_share": one.speed,
        "turn_share": one.turn,
    }


def _error(error: PathError) -> dict[str, Any]:
    return {
        "at_s": float(error.time_s[-1]),
        "position_m": [float(value) for value in error.position_at_end_m],
        "yaw_deg": [float(value) for value in np.degrees(error.yaw_at_end_rad)],
    }


def _judged(one: Judged) -> dict[str, Any]:
    borne = one.borne
    return {
        "quantity": one.quantity.title,
        "deviation": one.quantity.deviation,
        "bearable": None if borne is None else [borne.low, borne.high],
        "uncalibrated": _verdict(one.uncalibrated),
        "calibrated": _verdict(one.calibrated),
        "source": one.quantity.source,
    }


def _verdict(one: Verdict) -> dict[str, Any]:
    # A policy that bears nothing at all gives an infinite share, which JSON does not know.
    used = one.used if one.used is not None and np.isfinite(one.used) else None
    return {
        "verdict": one.word.value,
        "value": one.value,
        "used": used,
        "reward_share": one.reward_share,
        "why": one.why,
    }
