"""The result for people and for programs."""

import math
from collections.abc import Sequence
from statistics import median
from typing import TYPE_CHECKING

from msgspec import Struct
from rich.markup import escape
from rich.table import Table

from mbot_workstation.measure.identification.conclusions import QUANTILE_95
from mbot_workstation.measure.identification.motor_trim import TrimChoice
from mbot_workstation.measure.identification.result import (
    Identification,
    Misfit,
    ParameterEstimate,
    Repeatability,
    RunError,
    SteadyRate,
)
from mbot_workstation.measure.identification.solver import VarianceComponents
from mbot_workstation.measure.identification.validation import LEAST_TURNS_RAD, heading_share
from mbot_workstation.sim.body.parameter_table import BY_NAME

if TYPE_CHECKING:
    from mbot_workstation.learn.evaluation.trim_trial import TrimTrial

NOTEWORTHY_MISFIT = 0.02
"""Of the faster wheel's speed: the bar that a calibrated robot's speeds are held to
(docs/results/identification.md)."""

TELLING_SHARE = 0.01
"""Of a motor's strength: a difference between forward and backward worth telling."""


def error_table(found: Identification) -> Table:
    """Held-out runs before and after, a line a maneuver: medians."""
    table = Table(box=None, padding=(0, 2, 0, 0))
    table.add_column("held-out runs,\nmedians", no_wrap=True)
    for heading in ("place, cm", "heading, °"):
        table.add_column(f"{heading}\nbefore", justify="right")
        table.add_column("\nidentified", justify="right")
        table.add_column("\nrepeats to", justify="right")
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
    return [
        f"of runs that turn, {turns:.1f} times in the middle, the heading is off by "
        f"{100 * after:.2f} % of the angle turned, before {100 * before:.1f} %"
    ]


def parameter_table(found: Identification) -> Table:
    """All parameters that could be told."""
    table = Table(box=None, padding=(0, 2, 0, 0))
    table.add_column("parameter")
    for heading in ("before", "identified", "95 % interval"):
        table.add_column(heading, justify="right", no_wrap=True)
    for one in found.estimates:
        if one.low is not None and one.high is not None:
            known = BY_NAME[one.name]
            before, value, low, high = (
                f"{known.shown_factor * number:.4g}"
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


def _value_words(one: ParameterEstimate) -> str:
    factor = BY_NAME[one.name].shown_factor
    verb = "stays" if math.isclose(one.value, one.before) else "is taken as"
    return f"{verb} {factor * one.value:.4g}"


def steady_table(found: Identification) -> Table:
    """How the robot drives at full speed, how sure that is, and what the model misses."""
    misfits = {one.maneuver: one for one in found.misfits}
    table = Table(box=None, padding=(0, 2, 0, 0))
    table.add_column("at speed,\nfresh battery", no_wrap=True)
    for heading in ("speed,\nmm/s", "\n±", "turn rate,\nrad/s", "\n±", "model\nmisses"):
        table.add_column(heading, justify="right")
    for one in found.steady:
        missed = misfits.get(one.maneuver)
        table.add_row(
            one.maneuver,
            f"{1000 * one.speed_m_s:.0f}",
            f"{1000 * QUANTILE_95 * one.speed_sd:.0f}",
            f"{one.turn_rad_s:.2f}",
            f"{QUANTILE_95 * one.turn_sd:.2f}",
            "" if missed is None else f"{100 * missed.size:.1f} %",
        )
    return table


def misfit_lines(found: Identification) -> list[str]:
    """Where the model can't follow the robot; nothing where it can."""
    missed = sorted(found.misfits, key=lambda one: one.size, reverse=True)
    names = [
        f"{one.maneuver} ({100 * one.size:.1f} %)" for one in missed if one.size > NOTEWORTHY_MISFIT
    ]
    if not names:
        return []
    return [
        f"the model misses {', '.join(names)} every time, more than {100 * NOTEWORTHY_MISFIT:.0f} "
        "% of a wheel's speed: expect the simulation to be off by as much; are all runs of one "
        "robot, on one floor, with its motor maps as recorded?"
    ]


def trim_lines(uneven: TrimChoice) -> list[str]:
    """What the daemon can do about uneven motors, and what each way costs."""
    left, right = uneven.straight.left, uneven.straight.right
    if left.trim == right.trim:
        return ["both motors are equally strong: no trim"]
    side, trim = ("left", left.trim) if left.trim < 1 else ("right", right.trim)
    lines = [
        f"the {side} motor is the stronger one: trim {trim:.3f} drives straight at full command, "
        f"at {1000 * uneven.straight_m_s:.0f} mm/s"
    ]
    if uneven.is_a_choice:
        lines.append(
            f"that takes {100 * uneven.cost:.0f} % of the speed: with --no-trim it drives "
            f"{1000 * uneven.alone_m_s:.0f} mm/s, turning at {uneven.alone_turn_rad_s:+.2f} rad/s, "
            "and the policy has to steer against it; --policy POLICY.onnx tries which of the two "
            "it does better with"
        )
    return lines


def backward_lines(found: Identification) -> list[str]:
    """Motors that drive one way better than the other; where the recordings hardly tell, only such
    as differ by more than motors usually do."""
    told = {one.name for one in found.estimates if one.low is not None}
    least = {
        name: TELLING_SHARE if name in told else BY_NAME[name].spread
        for name in ("left_backward_share", "right_backward_share")
    }
    return [
        f"backward the {side} motor is {100 * abs(share - 1):.1f} % "
        f"{'stronger' if share > 1 else 'weaker'} than forward; its trim is for driving forward"
        for side, share in (
            ("left", found.robot.left_motor.backward_share),
            ("right", found.robot.right_motor.backward_share),
        )
        if abs(share - 1) > least[f"{side}_backward_share"]
    ]


class FittedParameter(Struct, frozen=True):
    """One parameter, in its own unit, and its 95 % interval; None: it can't be told."""

    value: float
    before: float
    low: float | None
    high: float | None
    undetermined: str | None


class FitAnswer(Struct, frozen=True, omit_defaults=True):
    """The result. Units are in the names, or the parameters' own as in `RobotParameters`."""

    robot: str
    runs_fitted: int
    runs_held_out: int
    left_out: dict[str, str]
    parameters: dict[str, FittedParameter]
    latency_s: FittedParameter
    steady: tuple[SteadyRate, ...]
    misfit: tuple[Misfit, ...]
    uneven_motors: TrimChoice
    scatter: VarianceComponents
    clock_drift: tuple[float, ...]
    tracker_ahead_left_yaw: tuple[tuple[float, float, float], ...]
    held_out: tuple[RunError, ...]
    repeatability: tuple[Repeatability, ...]
    written: list[str]
    trim_trial: "TrimTrial | None" = None


def fit_answer(
    found: Identification, uneven: TrimChoice, written: list[str], tried: "TrimTrial | None"
) -> FitAnswer:
    """For programs."""
    return FitAnswer(
        robot=found.robot_id,
        runs_fitted=found.fitted,
        runs_held_out=len(found.errors),
        left_out={name: one.why for name, one in found.excluded.items()},
        parameters={one.name: _parameter(one) for one in found.estimates},
        latency_s=_parameter(found.latency),
        steady=found.steady,
        misfit=found.misfits,
        uneven_motors=uneven,
        scatter=found.variances,
        clock_drift=found.clock_drift,
        tracker_ahead_left_yaw=found.tracker,
        held_out=found.errors,
        repeatability=found.repeatability,
        written=written,
        trim_trial=tried,
    )


def _parameter(one: ParameterEstimate) -> FittedParameter:
    return FittedParameter(one.value, one.before, one.low, one.high, one.why_not)


def _by_maneuver(errors: Sequence[RunError]) -> dict[str, list[RunError]]:
    result: dict[str, list[RunError]] = {}
    for error in errors:
        result.setdefault(error.maneuver, []).append(error)
    return result
