"""The result for people and for programs."""

import math
from collections.abc import Sequence
from dataclasses import asdict
from statistics import median
from typing import Any

from rich.markup import escape
from rich.table import Table

from mbot_protocol.actions import MotorMap
from mbot_workstation.identification.estimate import Estimate, Identification, RunError
from mbot_workstation.identification.held_out import LEAST_TURNS_RAD, heading_share
from mbot_workstation.identification.parameters import BY_NAME

TELLING_SHARE = 0.01
"""Of a motor's strength: a difference between forward and backward worth telling."""

TELLING_RAD = math.radians(1)
"""A heading's error that is worth an explanation."""


def error_table(found: Identification) -> Table:
    """Held-out runs before and after, a line a manoeuvre: medians."""
    table = Table(box=None, padding=(0, 2, 0, 0))
    table.add_column("held-out runs, medians")
    for heading in ("place, cm", "identified", "repeats to", "heading, °", "identified"):
        table.add_column(heading, justify="right")
    table.add_column("repeats to", justify="right")
    repeats = {one.maneuver: one for one in found.repeatability}
    for maneuver, errors in _by_maneuver(found.errors).items():
        own = repeats.get(maneuver)
        table.add_row(
            maneuver,
            f"{100 * median(e.before_m for e in errors):.1f}",
            f"{100 * median(e.after_m for e in errors):.1f}",
            "" if own is None else f"{100 * own.place_m:.1f}",
            f"{math.degrees(median(e.before_rad for e in errors)):.1f}",
            f"{math.degrees(median(e.after_rad for e in errors)):.1f}",
            "" if own is None else f"{math.degrees(own.heading_rad):.1f}",
        )
    return table


def error_lines(found: Identification) -> list[str]:
    """What the headings' errors come to: degrees say little about a robot that turns five times."""
    turning = [error for error in found.errors if abs(error.turned_rad) >= LEAST_TURNS_RAD]
    before, after = (
        heading_share([(getattr(error, name), error.turned_rad) for error in turning])
        for name in ("before_rad", "after_rad")
    )
    if before is None or after is None:
        return []
    turns = median(abs(error.turned_rad) for error in turning) / (2 * math.pi)
    lines = [
        f"of runs that turn, {turns:.1f} times in the middle, the heading is off by "
        f"{100 * after:.2f} % of the angle turned, before {100 * before:.1f} %"
    ]
    fastest = max(turning, key=lambda error: abs(error.turned_rad) / error.at_s)
    late_rad = found.scatter.moment_s * abs(fastest.turned_rad) / fastest.at_s
    if late_rad > TELLING_RAD:
        lines.append(
            f"runs begin {1000 * found.scatter.moment_s:.0f} ms (standard deviation) sooner or "
            f"later than their commands say: in {fastest.maneuver} that alone is "
            f"{math.degrees(late_rad):.1f} degrees, which no simulation can foresee"
        )
    return lines


def parameter_table(found: Identification) -> Table:
    """All parameters that could be told."""
    table = Table(box=None, padding=(0, 2, 0, 0))
    table.add_column("parameter")
    for heading in ("before", "identified", "95 % interval"):
        table.add_column(heading, justify="right")
    for one in found.estimates:
        if one.low is not None and one.high is not None:
            known = BY_NAME[one.name]
            before, value, low, high = (
                f"{known.factor * number:.4g}"
                for number in (one.before, one.value, one.low, one.high)
            )
            table.add_row(escape(known.words), before, value, f"{low} to {high}")
    latency = found.latency
    if latency.low is not None and latency.high is not None:
        table.add_row(
            escape("latency [ms]"),
            f"{1000 * latency.before:.4g}",
            f"{1000 * latency.value:.4g}",
            f"{1000 * latency.low:.4g} to {1000 * latency.high:.4g}",
        )
    return table


def undetermined_lines(found: Identification) -> list[str]:
    """What the recordings can't tell, and why."""
    lines = [
        f"{BY_NAME[one.name].words} {_value_words(one)}: {one.why_not}"
        for one in found.estimates
        if one.why_not is not None
    ]
    if found.latency.why_not is not None:
        lines.append(
            f"latency [ms] stays {1000 * found.latency.value:.4g}: {found.latency.why_not}"
        )
    return lines


def _value_words(one: Estimate) -> str:
    factor = BY_NAME[one.name].factor
    verb = "stays" if one.value == one.before else "is taken as"
    return f"{verb} {factor * one.value:.4g}"


def map_lines(left: MotorMap, right: MotorMap) -> list[str]:
    """What the daemon should do to drive straight, and why."""
    if left.trim == right.trim:
        return ["both motors are equally strong: no trim"]
    side, trim = ("left", left.trim) if left.trim < 1 else ("right", right.trim)
    return [
        f"the {side} motor is the stronger one: trim {trim:.3f}, and both wheels roll alike at "
        "full command"
    ]


def backward_lines(found: Identification) -> list[str]:
    """Motors that drive one way better than the other."""
    return [
        f"backward the {side} motor is {100 * abs(share - 1):.1f} % "
        f"{'stronger' if share > 1 else 'weaker'} than forward; its trim is for driving forward"
        for side, share in (
            ("left", found.robot.left_motor.backward_share),
            ("right", found.robot.right_motor.backward_share),
        )
        if abs(share - 1) > TELLING_SHARE
    ]


def as_fields(found: Identification, written: Sequence[str]) -> dict[str, Any]:
    """For programs. Units are in the names, or the parameters' own as in `RobotParameters`."""
    return {
        "robot": found.robot_id,
        "runs_fitted": found.fitted,
        "runs_held_out": len(found.errors),
        "left_out": found.left_out,
        "parameters": {one.name: _fields(one) for one in found.estimates},
        "latency_s": _fields(found.latency),
        "singular_values": found.singular_values,
        "scatter": asdict(found.scatter),
        "clock_drift": found.clock_drift,
        "tracker_ahead_left_yaw": found.tracker,
        "held_out": [asdict(error) for error in found.errors],
        "repeatability": [asdict(one) for one in found.repeatability],
        "written": list(written),
    }


def _fields(one: Estimate) -> dict[str, Any]:
    return {
        "value": one.value,
        "before": one.before,
        "low": one.low,
        "high": one.high,
        "undetermined": one.why_not,
    }


def _by_maneuver(errors: Sequence[RunError]) -> dict[str, list[RunError]]:
    result: dict[str, list[RunError]] = {}
    for error in errors:
        result.setdefault(error.maneuver, []).append(error)
    return result
